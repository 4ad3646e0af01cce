// Tests contents of fields and their encoding (V9, V10).
#include "usdlive/common/layer/FieldValue.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <string>

#include "unit/common/layer/RandomValue.h"

using namespace usdlive;

namespace {

Bytes encodedAs(ValueType type, const Bytes& body, std::uint8_t form = 0) {
    Bytes out;
    appendNumber<std::uint16_t>(out, std::uint16_t(type));
    out.push_back(form);
    appendNumber<std::uint64_t>(out, body.size());
    appendBytes(out, body);
    return out;
}

Bytes encoded(const Value& value) { return encodeFieldValue(value); }

bool isDecodable(const Bytes& bytes) { return decodeFieldValue(bytes).has_value(); }
bool isDecodable(const FieldValue& value) { return isDecodable(encodeFieldValue(value)); }

Dictionary nested(std::size_t levels) {
    Dictionary dictionary;
    for (; levels > 1; --levels) {
        Dictionary outer;
        outer.entries.emplace("k", std::move(dictionary));
        dictionary = std::move(outer);
    }
    return dictionary;
}

Value bigBlob() { return Value::blob(arrayOf(ValueType::Float3), sha256(asBytes("a")), 1 << 20); }

Bytes unregisteredNested(std::size_t levels) {
    const Bytes dictionary = encodeFieldValue(nested(levels));
    Bytes out{1};
    appendBytes(out, ByteView(dictionary).subspan(11));
    return out;
}

}  // namespace

TEST(FieldValue, V10LayoutOfALeafAndABlob) {
    EXPECT_EQ(encoded(boolValue(true)), (Bytes{1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1}));
    const Value blob = bigBlob();
    Bytes expected{0x20, 0x01, 1, 0, 0, 0x10, 0, 0, 0, 0, 0};
    appendBytes(expected, blob.hash().bytes);
    EXPECT_EQ(encoded(blob), expected);
    EXPECT_EQ(decodeFieldValue(expected), FieldValue(blob));
}

TEST(FieldValue, V10LayoutOfADictionary) {
    Dictionary dictionary;
    dictionary.entries.emplace("b", boolValue(true));
    dictionary.entries.emplace("a", Dictionary{});
    EXPECT_EQ(encodeFieldValue(dictionary),
              (Bytes{80, 0, 0, 41, 0,   0,  0, 0, 0, 0, 0,                             //
                     2,  0, 0, 0,                                                      //
                     1,  0, 0, 0,  'a', 80, 0, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,  //
                     1,  0, 0, 0,  'b', 1,  0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1}));
}

TEST(FieldValue, TypeIsThatOfTheContent) {
    EXPECT_EQ(FieldValue().type(), ValueType::None);
    EXPECT_EQ(FieldValue(boolValue(true)).type(), ValueType::Bool);
    EXPECT_EQ(FieldValue(Dictionary{}).type(), ValueType::Dictionary);
    EXPECT_EQ(FieldValue(TimeSamples{}).type(), ValueType::TimeSamples);
    EXPECT_EQ(FieldValue(ListOp{}).type(), ValueType::ListOp);
    EXPECT_EQ(FieldValue(Map{}).type(), ValueType::Map);
}

TEST(FieldValue, V10RefusesNoneUnknownTypesAndForms) {
    EXPECT_FALSE(isDecodable(FieldValue()));
    EXPECT_FALSE(isDecodable(encodedAs(ValueType(999), {})));
    EXPECT_FALSE(isDecodable(encodedAs(ValueType::Bool, {1}, 2)));
    EXPECT_FALSE(isDecodable(encodedAs(ValueType::Bool, Bytes(32), 1)));
    EXPECT_FALSE(isDecodable(encodedAs(ValueType::Bool, {2})));
    EXPECT_FALSE(isDecodable(Bytes{}));
    Bytes longer = encoded(boolValue(true));
    longer.push_back(0);
    EXPECT_FALSE(isDecodable(longer));
}

TEST(FieldValue, V10DictionariesHoldLeafsBlobsAndDictionariesOnly) {
    const auto holding = [](const Bytes& entry) {
        Bytes body{1, 0, 0, 0};
        appendText(body, "k");
        appendBytes(body, entry);
        return encodedAs(ValueType::Dictionary, body);
    };
    EXPECT_TRUE(isDecodable(holding(encoded(boolValue(true)))));
    EXPECT_TRUE(isDecodable(holding(encoded(bigBlob()))));
    EXPECT_TRUE(isDecodable(holding(encodeFieldValue(Dictionary{}))));
    EXPECT_FALSE(isDecodable(holding(encodeFieldValue(TimeSamples{}))));
    EXPECT_FALSE(isDecodable(holding(encodeFieldValue(Map{ValueType::String, {}}))));
    EXPECT_FALSE(isDecodable(holding(encoded(Value()))));
    ListOp listOp;
    listOp.itemType = ValueType::Token;
    EXPECT_TRUE(isDecodable(FieldValue(listOp)));
    EXPECT_FALSE(isDecodable(holding(encodeFieldValue(listOp))));
}

TEST(FieldValue, V10DictionaryKeysAscendByBytes) {
    const auto withKeys = [](std::initializer_list<std::string_view> keys) {
        Bytes body;
        appendNumber<std::uint32_t>(body, std::uint32_t(keys.size()));
        for (const auto key : keys) {
            appendText(body, key);
            appendBytes(body, encoded(boolValue(true)));
        }
        return encodedAs(ValueType::Dictionary, body);
    };
    EXPECT_TRUE(isDecodable(withKeys({"", "a", "a:b", "b", "\xC3\xA4"})));
    EXPECT_FALSE(isDecodable(withKeys({"b", "a"})));
    EXPECT_FALSE(isDecodable(withKeys({"a", "a"})));
    EXPECT_FALSE(isDecodable(withKeys({"\xC3\xA4", "z"})));
    EXPECT_FALSE(isDecodable(withKeys({"\xFF"})));
}

TEST(FieldValue, V10DictionariesNestAtMost64Deep) {
    EXPECT_EQ(nesting(nested(1)), 1U);
    EXPECT_EQ(nesting(nested(64)), 64U);
    EXPECT_TRUE(isDecodable(FieldValue(nested(kMaxNesting))));
    EXPECT_FALSE(isDecodable(FieldValue(nested(kMaxNesting + 1))));
    EXPECT_FALSE(isDecodable(FieldValue(nested(500))));
}

// The validity of a leaf does not depend on its place.
TEST(FieldValue, V10LevelsInsideALeafCountFromZero) {
    Dictionary deepest;
    deepest.entries.emplace("leaf", Value(ValueType::Unregistered, unregisteredNested(64)));
    for (int level = 1; level < 64; ++level) {
        Dictionary outer;
        outer.entries.emplace("k", std::move(deepest));
        deepest = std::move(outer);
    }
    EXPECT_TRUE(isDecodable(FieldValue(deepest)));
    EXPECT_FALSE(isDecodable(Value(ValueType::Unregistered, unregisteredNested(65))));
}

TEST(FieldValue, V10TimesAreFiniteAndAscend) {
    const auto withTimes = [](std::initializer_list<double> times) {
        Bytes body;
        appendNumber<std::uint64_t>(body, times.size());
        for (const double time : times) {
            appendNumber<double>(body, time);
            appendBytes(body, encoded(doubleValue(1)));
        }
        return encodedAs(ValueType::TimeSamples, body);
    };
    EXPECT_TRUE(isDecodable(withTimes({})));
    EXPECT_TRUE(isDecodable(withTimes({-1.5, 0, 1e300})));
    EXPECT_FALSE(isDecodable(withTimes({1, 1})));
    EXPECT_FALSE(isDecodable(withTimes({1, 0})));
    EXPECT_FALSE(isDecodable(withTimes({-0.0, 0.0})));
    EXPECT_FALSE(isDecodable(withTimes({std::numeric_limits<double>::quiet_NaN()})));
    EXPECT_FALSE(isDecodable(withTimes({-std::numeric_limits<double>::infinity()})));
}

TEST(FieldValue, V10ListOpsAreOfOneTypeAndEitherExplicitOrNot) {
    const auto filled = [](bool isExplicit, ListName list, const Value& item) {
        ListOp listOp;
        listOp.itemType = ValueType::Token;
        listOp.isExplicit = isExplicit;
        listOp[list].push_back(item);
        return FieldValue(listOp);
    };
    const Value item = tokenValue("a");
    for (std::size_t list = 0; list < kListNames; ++list) {
        const bool isFirst = ListName(list) == ListName::Explicit;
        EXPECT_EQ(isDecodable(filled(true, ListName(list), item)), isFirst);
        EXPECT_EQ(isDecodable(filled(false, ListName(list), item)), !isFirst);
    }
    EXPECT_FALSE(isDecodable(filled(true, ListName::Explicit, stringValue("a"))));
    EXPECT_FALSE(isDecodable(
        filled(true, ListName::Explicit, Value::blob(ValueType::Token, Hash{}, 1 << 20))));
    for (const auto type : {ValueType::None, ValueType::Double, arrayOf(ValueType::Int),
                            ValueType::Dictionary, ValueType(999)}) {
        ListOp listOp;
        listOp.itemType = type;
        EXPECT_FALSE(isDecodable(FieldValue(listOp))) << typeName(type);
    }
    Bytes explicitness = encodeFieldValue(filled(true, ListName::Explicit, item));
    explicitness[13] = 2;
    EXPECT_FALSE(isDecodable(explicitness));
}

TEST(FieldValue, V10MapKeysAreOfOneTypeAndDistinctInAnyOrder) {
    const auto withKeys = [](ValueType type, std::initializer_list<Value> keys) {
        Map map{type, {}};
        for (const Value& key : keys) map.entries.emplace_back(key, stringValue("v"));
        return FieldValue(map);
    };
    EXPECT_TRUE(isDecodable(withKeys(ValueType::String, {})));
    EXPECT_TRUE(isDecodable(withKeys(ValueType::Path, {pathValue("/B"), pathValue("/A")})));
    EXPECT_FALSE(isDecodable(
        withKeys(ValueType::Path, {pathValue("/A"), pathValue("/B"), pathValue("/A")})));
    EXPECT_FALSE(isDecodable(withKeys(ValueType::Path, {stringValue("/A")})));
    EXPECT_FALSE(isDecodable(withKeys(ValueType::Double, {doubleValue(1)})));
    EXPECT_FALSE(isDecodable(
        withKeys(ValueType::String, {Value::blob(ValueType::String, Hash{}, 1 << 20)})));
}

TEST(FieldValue, V9LeafsInsideLeafsAreNeverBlobs) {
    Dictionary customData;
    customData.entries.emplace("k", bigBlob());
    const Bytes dictionary = encodeFieldValue(customData);
    Bytes bytes{1};
    appendBytes(bytes, ByteView(dictionary).subspan(11));
    EXPECT_FALSE(validateValue(ValueType::Unregistered, bytes));
}

// A few bytes that claim a large content are refused at once and without allocating the memory.
TEST(FieldValue, V10FalseCountsAreRefused) {
    const Bytes huge(8, 0xFF);
    for (const auto type : {ValueType::Dictionary, ValueType::TimeSamples})
        EXPECT_FALSE(isDecodable(encodedAs(type, huge)));
    EXPECT_FALSE(isDecodable(encodedAs(ValueType::ListOp, {12, 0, 1, 0xFF, 0xFF, 0xFF, 0xFF})));
    EXPECT_FALSE(isDecodable(encodedAs(ValueType::Map, {12, 0, 0xFF, 0xFF, 0xFF, 0xFF})));
    Bytes size = encoded(boolValue(true));
    std::fill(size.begin() + 3, size.begin() + 11, std::uint8_t(0xFF));
    EXPECT_FALSE(isDecodable(size));
}

TEST(FieldValue, ItemKeyOfASubLayerIsItsAssetPath) {
    const auto subLayer = [](std::string_view path, double offset) {
        Bytes bytes;
        appendText(bytes, path);
        appendNumber<double>(bytes, offset);
        appendNumber<double>(bytes, 1);
        return Value(ValueType::SubLayer, std::move(bytes));
    };
    EXPECT_EQ(itemKey(subLayer("a.usd", 0)), itemKey(subLayer("a.usd", 10)));
    EXPECT_NE(itemKey(subLayer("a.usd", 0)), itemKey(subLayer("b.usd", 0)));
    const Value key = itemKey(subLayer("a.usd", 0));
    EXPECT_EQ(key.type(), ValueType::Asset);
    EXPECT_EQ(textOf(key), "a.usd");
    EXPECT_EQ(itemKey(tokenValue("a")), tokenValue("a"));
    EXPECT_EQ(itemKey(Value(ValueType::SubLayer, Bytes{9})).type(), ValueType::Asset);
}

TEST(FieldValue, V9ForEachBlobFindsAllBlobs) {
    const Value blob = bigBlob();
    const auto blobs = [](const FieldValue& value) {
        std::vector<Value> found;
        forEachBlob(value, [&](const Value& each) { found.push_back(each); });
        return found;
    };
    Dictionary inner, outer;
    inner.entries.emplace("a", blob);
    outer.entries.emplace("b", inner);
    outer.entries.emplace("c", boolValue(true));
    const std::vector<Value> one{blob};
    EXPECT_EQ(blobs(blob), one);
    EXPECT_EQ(blobs(outer), one);
    EXPECT_EQ(blobs(TimeSamples{{{1.0, blob}, {2.0, doubleValue(1)}}}), one);
    EXPECT_EQ(blobs((Map{ValueType::String, {{stringValue("k"), blob}}})), one);
    EXPECT_TRUE(blobs(ListOp{}).empty());
    EXPECT_TRUE(blobs(FieldValue()).empty());
}

TEST(FieldValue, V10RandomContentRoundTrips) {
    for (unsigned seed = 0; seed < 3000; ++seed) {
        SCOPED_TRACE(seed);
        const FieldValue value = RandomValue(seed).field();
        const Bytes bytes = encodeFieldValue(value);
        const auto decoded = decodeFieldValue(bytes);
        ASSERT_TRUE(decoded) << decoded.error().message;
        ASSERT_EQ(*decoded, value);
        ASSERT_EQ(encodeFieldValue(*decoded), bytes);
        for (std::size_t size = 0; size < bytes.size(); size += 1 + bytes.size() / 50)
            ASSERT_FALSE(decodeFieldValue(ByteView(bytes).first(size)));
    }
}

namespace {

void mutate(Bytes& bytes, std::mt19937& random) {
    static constexpr std::uint8_t kLikely[] = {0,  1,  2,  4,  11, 12,  58,
                                               61, 80, 81, 82, 83, 127, 255};
    const auto at = [&] { return bytes.begin() + std::ptrdiff_t(random() % bytes.size()); };
    if (bytes.empty()) return bytes.push_back(1);
    switch (random() % 6) {
        case 0:
            *at() ^= std::uint8_t(1 << random() % 8);
            return;
        case 1:
            *at() = kLikely[random() % std::size(kLikely)];
            return;
        case 2:
            bytes.insert(at(), std::uint8_t(random()));
            return;
        case 3:
            bytes.erase(at());
            return;
        case 4:
            bytes.erase(at(), bytes.end());
            return;
        default:
            std::iter_swap(at(), at());
    }
}

}  // namespace

// V10 is canonical: bytes are either refused, or the only encoding of their content.
TEST(FieldValue, V10MutatedBytesAreRefusedOrEncodeToThemselves) {
    int accepted = 0, refused = 0;
    for (unsigned seed = 0; seed < 1500; ++seed) {
        SCOPED_TRACE(seed);
        const Bytes original = encodeFieldValue(RandomValue(seed).field());
        std::mt19937 random(seed);
        for (int round = 0; round < 60; ++round) {
            Bytes bytes = original;
            for (auto left = 1 + random() % 3; left > 0; --left) mutate(bytes, random);
            const auto decoded = decodeFieldValue(bytes);
            ++(decoded ? accepted : refused);
            if (!decoded) continue;
            ASSERT_EQ(encodeFieldValue(*decoded), bytes);
        }
    }
    EXPECT_GT(accepted, 1000) << "all mutations were refused, so nothing was tested";
    EXPECT_GT(refused, 1000);
}
