// A store of big values in memory, for tests.
#pragma once

#include <map>

#include "usdlive/common/usd/ValueCodec.h"

namespace usdlive::test {

/// Big values in memory.
class MemoryBlobs : public BlobSink, public BlobSource {
public:
    void keepBlob(const Hash& hash, SharedBytes bytes) override {
        all.insert_or_assign(hash, std::move(bytes));
    }
    SharedBytes blob(const Hash& hash) override {
        const auto found = all.find(hash);
        return found == all.end() ? nullptr : found->second;
    }

    std::map<Hash, SharedBytes> all;
};

}  // namespace usdlive::test
