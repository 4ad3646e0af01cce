// Tests the decompression of answers (AS5).
#include "usdlive/common/fetch/Inflated.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zstd.h>

#include <algorithm>
#include <random>

using namespace usdlive::fetch;
using testing::HasSubstr;

namespace {

class Collected final : public BodySink {
public:
    explicit Collected(std::size_t part) : part_(part, '\0') {}
    std::span<char> space() override { return part_; }
    std::string add(std::size_t size) override {
        text.append(part_.data(), size);
        return text.size() > most ? "no more" : "";
    }
    std::string text;
    std::size_t most = std::size_t(-1);

private:
    std::vector<char> part_;
};

std::string frameOf(const std::string& text) {
    std::string frame(ZSTD_compressBound(text.size()), '\0');
    frame.resize(ZSTD_compress(frame.data(), frame.size(), text.data(), text.size(), 1));
    return frame;
}

/// Adds it in parts of at most `most` bytes. Returns the first problem.
std::string inflate(std::string_view frame, std::size_t most, BodySink& sink) {
    Inflated inflated(sink);
    while (!frame.empty()) {
        const std::span<char> space = inflated.space();
        const std::size_t size = frame.copy(space.data(), std::min(space.size(), most));
        if (std::string problem = inflated.add(size); !problem.empty()) return problem;
        frame.remove_prefix(size);
    }
    return inflated.finish();
}

std::string someText(std::size_t size) {
    std::mt19937 random{2};
    std::string text(size, '\0');
    for (char& letter : text) letter = char('a' + random() % 7);
    return text;
}

}  // namespace

TEST(Inflated, AS5IsTheSameInPartsOfAnySize) {
    for (const std::size_t size : {0, 1, 1'000, 300'000}) {
        const std::string text = someText(size), frame = frameOf(text);
        for (const std::size_t part : {7, 4'096, 1'000'000})
            for (const std::size_t target : {13, 4'096, 1'000'000}) {
                if (size > 1'000 && part * target < 1'000) continue;  // takes long
                Collected sink(target);
                EXPECT_EQ(inflate(frame, part, sink), "");
                EXPECT_EQ(sink.text, text) << size << " " << part << " " << target;
            }
    }
}

TEST(Inflated, AS5SaysWhatIsWrong) {
    const std::string frame = frameOf(someText(100'000));
    const auto problem = [](const std::string& damaged) {
        Collected sink(4'096);
        return inflate(damaged, 4'096, sink);
    };
    for (const std::size_t size : {std::size_t(0), std::size_t(3), frame.size() - 1})
        EXPECT_THAT(problem(frame.substr(0, size)), HasSubstr("is not complete")) << size;
    EXPECT_THAT(problem(frame + "x"), HasSubstr("longer than its frame"));
    EXPECT_THAT(problem("no frame at all"), HasSubstr("is damaged"));
    Collected full(4'096);
    full.most = 50'000;
    EXPECT_EQ(inflate(frame, 4'096, full), "no more");
    EXPECT_LT(full.text.size(), 60'000u);
}

TEST(Inflated, AS5EndsABomb) {
    const std::string frame = frameOf(std::string(Inflated::kMostBytes + 1'000'000, ' '));
    EXPECT_LT(frame.size(), 100'000u);
    Collected sink(1'000'000);
    EXPECT_THAT(inflate(frame, 4'096, sink), HasSubstr("too large"));
    EXPECT_LE(sink.text.size(), Inflated::kMostBytes);
}
