// Tests that big arrays are encoded beside the frame, with the same result as within it.
#include "usd/live/ArrayEncodings.h"

#include <gtest/gtest.h>
#include <pxr/base/gf/vec3f.h>
#include <pxr/base/vt/array.h>

#include <future>
#include <map>
#include <thread>

namespace usdlive::client {
namespace {

struct Kept final : BlobSink {
    void keepBlob(const Hash& hash, SharedBytes bytes) override { blobs[hash] = std::move(bytes); }
    std::map<Hash, SharedBytes> blobs;
};

pxr::VtValue points(std::size_t count, float x) {
    return pxr::VtValue(pxr::VtArray<pxr::GfVec3f>(count, pxr::GfVec3f(x, 0, 0)));
}

class ArrayEncodingsTest : public testing::Test {
protected:
    // Lets the worker start; nothing is encoded before.
    void letWorkerGo() { gate_.set_value(); }
    void waitForWorker() {
        std::promise<void> done;
        worker_.post([&] { done.set_value(); });
        done.get_future().wait();
    }

    std::promise<void> gate_;
    Kept kept_;
    Worker worker_;
    ArrayEncodings encodings_{kept_, worker_};
    ArrayEncodingsTest() {
        worker_.post([opened = gate_.get_future().share()] { opened.wait(); });
    }
};

TEST_F(ArrayEncodingsTest, AFrameWithoutBigArraysDoesNotWait) {
    EXPECT_TRUE(encodings_.areReady({}, 0));
    letWorkerGo();
}

TEST_F(ArrayEncodingsTest, AFrameWaitsAndGetsTheResultOfTheCodec) {
    const auto array = points(400'000, 1);
    EXPECT_FALSE(encodings_.areReady({array}, 0));
    EXPECT_FALSE(encodings_.areReady({array}, 1));
    EXPECT_FALSE(encodings_.encodedArrays()->encoded(array));
    letWorkerGo();
    waitForWorker();
    EXPECT_TRUE(encodings_.areReady({array}, 2));

    Kept direct;
    const auto wanted = usd::encodeLeaf(array, direct);
    ASSERT_TRUE(wanted);
    EXPECT_EQ(usd::encodeLeaf(array, encodings_), wanted);
    ASSERT_EQ(kept_.blobs.size(), 1u);
    EXPECT_EQ(*kept_.blobs.at(wanted->hash()), *direct.blobs.at(wanted->hash()));

    encodings_.clear();
    EXPECT_FALSE(encodings_.encodedArrays()->encoded(array));
}

TEST_F(ArrayEncodingsTest, AnArrayWrittenAgainMeanwhileIsEncodedWithinTheFrame) {
    letWorkerGo();
    EXPECT_FALSE(encodings_.areReady({points(400'000, 1)}, 0));
    waitForWorker();
    const auto second = points(400'000, 2);
    EXPECT_TRUE(encodings_.areReady({second}, 10));
    EXPECT_FALSE(encodings_.encodedArrays()->encoded(second));
    Kept direct;
    EXPECT_EQ(usd::encodeLeaf(second, encodings_), usd::encodeLeaf(second, direct));
    encodings_.clear();
    // And so are the next arrays, for a while.
    const auto third = points(400'000, 3);
    EXPECT_TRUE(encodings_.areReady({third}, 10 + ArrayEncodings::kAtOnceMs - 1));
    EXPECT_FALSE(encodings_.areReady({third}, 10 + ArrayEncodings::kAtOnceMs));
}

TEST_F(ArrayEncodingsTest, AnArrayThatCannotBeEncodedIsLeftToTheFrame) {
    letWorkerGo();
    const pxr::VtValue array(pxr::VtArray<std::string>(400'000, "\xff"));  // not UTF-8
    EXPECT_FALSE(encodings_.areReady({array}, 0));
    waitForWorker();
    EXPECT_TRUE(encodings_.areReady({array}, 1));
    EXPECT_FALSE(usd::encodeLeaf(array, encodings_));
    EXPECT_TRUE(kept_.blobs.empty());
}

}  // namespace
}  // namespace usdlive::client
