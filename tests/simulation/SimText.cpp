// Writes a layer as text with USD, and reads it back.
#include "SimText.h"

#include "SimClock.h"
#include "usdlive/common/usd/LayerFill.h"

namespace usdlive::simulation {

namespace {

class Blobs : public BlobSource {
public:
    explicit Blobs(const server::BlobStore& store) : store_(store) {}
    [[nodiscard]] SharedBytes blob(const Hash& hash) override {
        const auto size = store_.size(hash);
        if (!size) return nullptr;
        return std::make_shared<const Bytes>(*store_.read(hash, 0, *size));
    }

private:
    const server::BlobStore& store_;
};

}  // namespace

std::string usdText(const LayerDoc& doc, const server::BlobStore& blobs) {
    Blobs source(blobs);
    auto text = usd::exportText(doc, source);
    require(text.has_value(),
            text ? "" : "the layer cannot be written as text: " + text.error().message);
    return *std::move(text);
}

}  // namespace usdlive::simulation
