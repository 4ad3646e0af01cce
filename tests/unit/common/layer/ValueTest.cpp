// Tests values and their encoding (V1-V9).
#include "usdlive/common/layer/Value.h"

#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <random>
#include <string>

#include "unit/common/layer/RandomValue.h"
#include "usdlive/common/core/Utf8.h"

using namespace usdlive;

namespace {

bool isValid(ValueType type, const Bytes& bytes) { return validateValue(type, bytes).has_value(); }

Bytes text(std::string_view text) {
    Bytes out;
    appendText(out, text);
    return out;
}

Bytes joined(std::initializer_list<Bytes> parts) {
    Bytes out;
    for (const Bytes& part : parts) appendBytes(out, part);
    return out;
}

template <Number T>
Bytes numbers(std::initializer_list<std::type_identity_t<T>> given) {
    Bytes out;
    for (const T number : given) appendNumber<T>(out, number);
    return out;
}

// Returns dictionary bodies, nested `levels` deep; the innermost is empty.
Bytes nestedBody(std::size_t levels) {
    Bytes body = numbers<std::uint32_t>({0});
    for (; levels > 1; --levels) {
        const auto type = std::uint16_t(ValueType::Dictionary);
        body = joined({numbers<std::uint32_t>({1}), text("k"), numbers<std::uint16_t>({type}),
                       Bytes{0}, numbers<std::uint64_t>({body.size()}), body});
    }
    return body;
}

Bytes unregisteredDictionary(std::size_t levels) { return joined({Bytes{1}, nestedBody(levels)}); }

// Returns nested list ops of unregistered values; the innermost is a text.
Bytes unregisteredLists(std::size_t levels) {
    Bytes value = joined({Bytes{0}, text("x")});
    for (; levels > 0; --levels) {
        const auto type = std::uint16_t(ValueType::Unregistered);
        value = joined({Bytes{2}, numbers<std::uint16_t>({type}), Bytes{1},
                        numbers<std::uint32_t>({1}), numbers<std::uint16_t>({type}), Bytes{0},
                        numbers<std::uint64_t>({value.size()}), value,
                        numbers<std::uint32_t>({0, 0, 0, 0, 0})});
    }
    return value;
}

constexpr std::uint64_t word(std::uint64_t operation, std::uint64_t count) {
    return operation << 56 | count;
}

// Returns an edit of an array of floats with two literals.
Bytes floatEdit(std::initializer_list<std::uint64_t> words) {
    return joined({numbers<std::uint64_t>({2}), numbers<float>({1, 2}),
                   numbers<std::uint64_t>({words.size()}), numbers<std::uint64_t>(words)});
}

}  // namespace

TEST(Value, IsSmallAndSharesLargerContent) {
    static_assert(sizeof(Value) <= 40);
    const Value small(ValueType::Double3, Bytes(24, 7)), large(ValueType::Double4, Bytes(32, 7));
    const Value smallCopy = small, largeCopy = large;
    EXPECT_NE(small.bytes().data(), smallCopy.bytes().data());
    EXPECT_EQ(large.bytes().data(), largeCopy.bytes().data());
    EXPECT_EQ(small, smallCopy);
    EXPECT_EQ(large, largeCopy);
}

TEST(Value, HoldsBytesOfEverySizeAroundTheInlineLimit) {
    for (std::size_t size = 0; size < 40; ++size) {
        Bytes bytes(size);
        for (std::size_t index = 0; index < size; ++index) bytes[index] = std::uint8_t(index + 1);
        const Value moved(ValueType::String, Bytes(bytes)),
            viewed(ValueType::String, ByteView(bytes));
        EXPECT_EQ(Bytes(moved.bytes().begin(), moved.bytes().end()), bytes);
        EXPECT_EQ(moved.size(), size);
        EXPECT_EQ(moved, viewed);
        EXPECT_FALSE(moved.isBlob());
    }
}

TEST(Value, IsEmptyByDefault) {
    const Value value;
    EXPECT_EQ(value.type(), ValueType::None);
    EXPECT_EQ(value.size(), 0U);
    EXPECT_EQ(value, Value());
}

TEST(Value, V9ABlobIsItsNameAndSize) {
    const ValueType type = arrayOf(ValueType::Float);
    const Hash hash = sha256(asBytes("a"));
    const Value blob = Value::blob(type, hash, 1'000'000);
    EXPECT_TRUE(blob.isBlob());
    EXPECT_TRUE(blob.bytes().empty());
    EXPECT_EQ(blob.size(), 1'000'000U);
    EXPECT_EQ(blob.hash(), hash);
    EXPECT_EQ(blob, Value::blob(type, hash, 1'000'000));
    EXPECT_NE(blob, Value::blob(type, sha256(asBytes("b")), 1'000'000));
    EXPECT_NE(blob, Value::blob(type, hash, 1));
    EXPECT_NE(blob, Value(type, ByteView(hash.bytes)));
}

TEST(Value, V9OnlyArraysTextsAndSplinesMayBeBlobs) {
    EXPECT_TRUE(canBeBlob(arrayOf(ValueType::Bool)));
    EXPECT_TRUE(canBeBlob(arrayEditOf(ValueType::Token)));
    EXPECT_TRUE(canBeBlob(ValueType::String));
    EXPECT_TRUE(canBeBlob(ValueType::Spline));
    for (const auto type : {ValueType::None, ValueType::Double, ValueType::Matrix4d,
                            ValueType::Reference, ValueType::TokenVector, ValueType::Dictionary,
                            ValueType::Unregistered, arrayOf(ValueType::Opaque), ValueType(999)})
        EXPECT_FALSE(canBeBlob(type)) << typeName(type);
}

TEST(Value, OrdersByTypeThenBlobnessThenBytes) {
    const auto value = [](ValueType type, std::initializer_list<std::uint8_t> bytes) {
        return Value(type, Bytes(bytes));
    };
    const Hash zero{};
    const std::vector<Value> ascending{
        value(ValueType::Int, {9}),
        value(ValueType::String, {}),
        value(ValueType::String, {1}),
        value(ValueType::String, {1, 0}),
        value(ValueType::String, {2}),
        value(ValueType::String, {200}),
        Value(ValueType::String, Bytes(20, 200)),
        Value::blob(ValueType::String, zero, 0),
        Value::blob(ValueType::String, zero, 1),
        Value::blob(ValueType::String, sha256(ByteView{}), 0),
        value(ValueType::Token, {}),
    };
    for (std::size_t left = 0; left < ascending.size(); ++left)
        for (std::size_t right = 0; right < ascending.size(); ++right) {
            EXPECT_EQ(ascending[left] <=> ascending[right], left <=> right) << left << " " << right;
            EXPECT_EQ(ascending[left] == ascending[right], left == right);
        }
}

TEST(Value, V1LeafTypesAreThoseOfTheList) {
    for (const auto type : {ValueType::Bool, ValueType::Opaque, ValueType::Double4,
                            ValueType::Block, ValueType::LayerOffset, arrayOf(ValueType::Bool),
                            arrayOf(ValueType::PathExpression), arrayEditOf(ValueType::Quath)})
        EXPECT_TRUE(isLeafType(type)) << typeName(type);
    for (const auto type :
         {ValueType::None, ValueType(17), ValueType(19), ValueType(38), ValueType(49),
          ValueType(63), ValueType::Dictionary, ValueType::Map, ValueType(0x100), ValueType(0x200),
          arrayOf(ValueType::Path), arrayOf(ValueType::Opaque), arrayOf(ValueType::Block),
          arrayOf(ValueType::Dictionary), arrayEditOf(arrayOf(ValueType::Float)),
          ValueType(0x400 + 8), ValueType(0xFFFF)}) {
        EXPECT_FALSE(isLeafType(type)) << typeName(type);
        EXPECT_FALSE(isValid(type, {}));
    }
    EXPECT_EQ(allLeafTypes().size(), 16U + 18 + 13 + 2 * (14 + 18));
}

TEST(Value, TypesHaveNames) {
    EXPECT_EQ(typeName(ValueType::None), "None");
    EXPECT_EQ(typeName(ValueType::Quath), "Quath");
    EXPECT_EQ(typeName(ValueType::Double4), "Double4");
    EXPECT_EQ(typeName(ValueType::LayerOffset), "LayerOffset");
    EXPECT_EQ(typeName(ValueType::Map), "Map");
    EXPECT_EQ(typeName(arrayOf(ValueType::Float3)), "Float3[]");
    EXPECT_EQ(typeName(arrayEditOf(ValueType::Token)), "Token[edit]");
    EXPECT_EQ(typeName(ValueType(17)), "type 17");
    EXPECT_EQ(typeName(ValueType(999)), "type 999");
    EXPECT_EQ(typeName(arrayOf(ValueType::Map)), "type 339");
}

TEST(Value, V2ScalarsHaveTheirSize) {
    const std::map<ValueType, std::size_t> sizes{
        {ValueType::Bool, 1},           {ValueType::UChar, 1},       {ValueType::Int, 4},
        {ValueType::UInt, 4},           {ValueType::Int64, 8},       {ValueType::UInt64, 8},
        {ValueType::Half, 2},           {ValueType::Float, 4},       {ValueType::Double, 8},
        {ValueType::TimeCode, 8},       {ValueType::Opaque, 0},      {ValueType::Matrix2d, 32},
        {ValueType::Matrix3d, 72},      {ValueType::Matrix4d, 128},  {ValueType::Quath, 8},
        {ValueType::Quatf, 16},         {ValueType::Quatd, 32},      {ValueType::Int2, 8},
        {ValueType::Half2, 4},          {ValueType::Float2, 8},      {ValueType::Double2, 16},
        {ValueType::Int3, 12},          {ValueType::Half3, 6},       {ValueType::Float3, 12},
        {ValueType::Double3, 24},       {ValueType::Int4, 16},       {ValueType::Half4, 8},
        {ValueType::Float4, 16},        {ValueType::Double4, 32},    {ValueType::Block, 0},
        {ValueType::AnimationBlock, 0}, {ValueType::Specifier, 1},   {ValueType::Variability, 1},
        {ValueType::Permission, 1},     {ValueType::LayerOffset, 16}};
    for (const auto& [type, size] : sizes) {
        EXPECT_TRUE(isValid(type, Bytes(size))) << typeName(type);
        EXPECT_FALSE(isValid(type, Bytes(size + 1))) << typeName(type);
        if (size > 0) {
            EXPECT_FALSE(isValid(type, Bytes(size - 1))) << typeName(type);
        }
    }
}

TEST(Value, V2V3OneByteTypesAreInTheirRange) {
    const std::map<ValueType, int> highest{{ValueType::Bool, 1},
                                           {ValueType::UChar, 255},
                                           {ValueType::Specifier, 2},
                                           {ValueType::Variability, 1},
                                           {ValueType::Permission, 1}};
    for (const auto& [type, last] : highest)
        for (int number = 0; number < 256; ++number)
            EXPECT_EQ(isValid(type, {std::uint8_t(number)}), number <= last) << typeName(type);
}

TEST(Value, V4TextsAreWholeUtf8AndNamesHoldNoNul) {
    const std::string_view withNul("a\0b", 3);
    for (const auto type : {ValueType::String, ValueType::Token, ValueType::Asset,
                            ValueType::PathExpression, ValueType::Path}) {
        EXPECT_TRUE(isValid(type, text("")));
        EXPECT_TRUE(isValid(type, text("\xC3\xA4 \n")));
        EXPECT_FALSE(isValid(type, text("a\xFF")));
        EXPECT_FALSE(isValid(type, text("\xED\xA0\x80")));
        EXPECT_FALSE(isValid(type, joined({text("a"), {0}})));
        EXPECT_FALSE(isValid(type, {5, 0, 0, 0, 'a'}));
        EXPECT_FALSE(isValid(type, {0xFF, 0xFF, 0xFF, 0xFF, 'a'}));
        EXPECT_FALSE(isValid(type, {1, 0, 0}));
        EXPECT_FALSE(isValid(type, {}));
        EXPECT_EQ(isValid(type, text(withNul)), type == ValueType::String);
    }
}

TEST(Value, V4PathsAndExpressionsAreNotTooDeep) {
    const auto repeated = [](std::string_view part, std::size_t times) {
        std::string all;
        for (std::size_t i = 0; i < times; ++i) all += part;
        return all;
    };
    EXPECT_TRUE(isValid(ValueType::Path, text(repeated("/d", 1024))));
    EXPECT_FALSE(isValid(ValueType::Path, text(repeated("/d", 1025))));
    EXPECT_FALSE(isValid(ValueType::Path, text(repeated("/d", 1023) + ".r[/T]")));
    EXPECT_TRUE(isValid(ValueType::Path, text("/" + std::string(16'383, 'd'))));
    EXPECT_FALSE(isValid(ValueType::Path, text("/" + std::string(16'384, 'd'))));
    EXPECT_TRUE(isValid(ValueType::String, text(repeated("/d", 10'000))));

    const auto nested = [&](std::size_t depth) {
        return text(repeated("(", depth) + "/a" + repeated(")", depth));
    };
    EXPECT_TRUE(isValid(ValueType::PathExpression, nested(256)));
    EXPECT_FALSE(isValid(ValueType::PathExpression, nested(257)));
    EXPECT_TRUE(isValid(ValueType::PathExpression, text(repeated("(/a) + ", 1000) + "/a")));

    const Bytes offset = numbers<double>({0, 1});
    const Bytes deep = joined({text("a.usd"), text(repeated("/d", 1025)), offset});
    EXPECT_FALSE(isValid(ValueType::Payload, deep));
    EXPECT_FALSE(isValid(ValueType::Reference, joined({deep, nestedBody(2)})));
}

TEST(Value, V5ArraysArePacked) {
    const auto count = [](std::uint64_t number) { return numbers<std::uint64_t>({number}); };
    EXPECT_TRUE(isValid(arrayOf(ValueType::Half3), joined({count(3), Bytes(18)})));
    EXPECT_TRUE(isValid(arrayOf(ValueType::Half3), count(0)));
    EXPECT_FALSE(isValid(arrayOf(ValueType::Half3), joined({count(3), Bytes(17)})));
    EXPECT_FALSE(isValid(arrayOf(ValueType::Half3), joined({count(3), Bytes(19)})));
    EXPECT_FALSE(isValid(arrayOf(ValueType::Half3), Bytes(7)));
    EXPECT_TRUE(isValid(arrayOf(ValueType::Bool), joined({count(2), {1, 0}})));
    EXPECT_FALSE(isValid(arrayOf(ValueType::Bool), joined({count(2), {1, 2}})));
    EXPECT_TRUE(isValid(arrayOf(ValueType::Token), joined({count(2), text("a"), text("bc")})));
    EXPECT_FALSE(isValid(arrayOf(ValueType::Token), joined({count(3), text("a"), text("bc")})));
    EXPECT_FALSE(isValid(arrayOf(ValueType::Token), joined({count(1), text("a"), text("bc")})));
    EXPECT_FALSE(isValid(arrayOf(ValueType::Token), joined({count(1), text("\xFF")})));
}

// Uses counts whose product with the element's size overflows to a small number.
TEST(Value, V5CountsDoNotOverflow) {
    for (const auto type : allLeafTypes()) {
        if (std::uint16_t(type) < 0x100) continue;
        for (const std::uint64_t count :
             {0xFFFF'FFFF'FFFF'FFFFULL, 0x8000'0000'0000'0000ULL, 0x4000'0000'0000'0000ULL,
              0x2000'0000'0000'0000ULL, 0x1000'0000'0000'0000ULL, 0x1'0000'0000ULL,
              0x5555'5555'5555'5556ULL, 0xAAAA'AAAA'AAAA'AAABULL})
            EXPECT_FALSE(isValid(type, joined({numbers<std::uint64_t>({count}), Bytes(64)})));
    }
}

TEST(Value, V6ArrayEditsAreLiteralsAndInstructions) {
    const ValueType type = arrayEditOf(ValueType::Float);
    constexpr auto kEnd = std::uint64_t(std::numeric_limits<std::int64_t>::min());
    EXPECT_TRUE(isValid(type, numbers<std::uint64_t>({0, 0})));  // the edit that changes nothing
    EXPECT_TRUE(isValid(type, floatEdit({word(0, 2), 0, 5, 1, std::uint64_t(-1)})));
    EXPECT_TRUE(isValid(type, floatEdit({word(2, 1), 1, kEnd, word(4, 2), 7, 8})));
    EXPECT_TRUE(isValid(type, floatEdit({word(5, 1), 10, word(8, 1), 10, 1, word(9, 1), 3})));
    EXPECT_TRUE(isValid(arrayEditOf(ValueType::Token),
                        joined({numbers<std::uint64_t>({1}), text("a"),
                                numbers<std::uint64_t>({3, word(0, 1), 0, 0})})));
}

// Each of these makes Vt read foreign memory, run very long, or allocate all memory.
TEST(Value, V6InstructionsThatHarmVtAreRefused) {
    const ValueType type = arrayEditOf(ValueType::Float);
    EXPECT_FALSE(isValid(type, floatEdit({word(10, 1), 0, 0}))) << "no such operation";
    EXPECT_FALSE(isValid(type, floatEdit({word(255, 1), 0, 0})));
    EXPECT_FALSE(isValid(type, floatEdit({word(0, 0)}))) << "no repetition";
    EXPECT_FALSE(isValid(type, floatEdit({word(0, 1)}))) << "no arguments";
    EXPECT_FALSE(isValid(type, floatEdit({word(0, 1), 0})));
    EXPECT_FALSE(isValid(type, floatEdit({word(4, 2), 0})));
    EXPECT_FALSE(isValid(type, floatEdit({word(4, 0x00FF'FFFF'FFFF'FFFFU), 0}))) << "count -1";
    EXPECT_FALSE(isValid(type, floatEdit({word(0, 1), 2, 0}))) << "no such literal";
    EXPECT_FALSE(isValid(type, floatEdit({word(2, 1), std::uint64_t(-1), 0})));
    EXPECT_FALSE(isValid(type, floatEdit({word(6, 1), 3, 2})));
    EXPECT_FALSE(isValid(type, floatEdit({word(7, 1), std::uint64_t(-1)}))) << "negative size";
    EXPECT_FALSE(isValid(type, floatEdit({word(7, 1), 1ULL << 40}))) << "a terabyte";
    EXPECT_TRUE(isValid(type, floatEdit({word(7, 1), 1ULL << 28}))) << "1 GiB of floats";
    EXPECT_FALSE(isValid(type, floatEdit({word(7, 1), (1ULL << 28) + 1})));

    Bytes tooFew = floatEdit({word(4, 1), 0});
    tooFew.pop_back();
    EXPECT_FALSE(isValid(type, tooFew));
    EXPECT_FALSE(isValid(type, joined({floatEdit({word(4, 1), 0}), {0}})));
    EXPECT_FALSE(isValid(type, numbers<std::uint64_t>({0})));
    EXPECT_FALSE(isValid(type, numbers<std::uint64_t>({0, 0xFFFF'FFFF'FFFF'FFFFULL, 0})));
}

TEST(Value, V7SplinesCarryTheirCustomDataByAscendingTime) {
    const auto spline = [](std::initializer_list<double> times) {
        Bytes out = joined({numbers<std::uint32_t>({3}),
                            {1, 2, 3},
                            numbers<std::uint32_t>({std::uint32_t(times.size())})});
        for (const double time : times) out = joined({out, numbers<double>({time}), nestedBody(1)});
        return out;
    };
    EXPECT_TRUE(isValid(ValueType::Spline, spline({})));
    EXPECT_TRUE(isValid(ValueType::Spline, spline({-1, 0, 2.5})));
    EXPECT_FALSE(isValid(ValueType::Spline, spline({1, 1})));
    EXPECT_FALSE(isValid(ValueType::Spline, spline({2, 1})));
    EXPECT_FALSE(isValid(ValueType::Spline, spline({std::numeric_limits<double>::quiet_NaN()})));
    EXPECT_FALSE(isValid(ValueType::Spline, spline({std::numeric_limits<double>::infinity()})));
    EXPECT_FALSE(isValid(ValueType::Spline, {3, 0, 0, 0, 1, 2}));
    EXPECT_FALSE(isValid(ValueType::Spline, {0, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF}));
}

TEST(Value, V8ReferencesPayloadsAndSubLayers) {
    const Bytes offset = numbers<double>({10, 2});
    const Bytes payload = joined({text("a.usd"), text("/A"), offset});
    const Bytes reference = joined({payload, nestedBody(2)});
    const Bytes subLayer = joined({text("a.usd"), offset});
    EXPECT_TRUE(isValid(ValueType::Payload, payload));
    EXPECT_TRUE(isValid(ValueType::Reference, reference));
    EXPECT_TRUE(isValid(ValueType::SubLayer, subLayer));
    EXPECT_FALSE(isValid(ValueType::Reference, payload));
    EXPECT_FALSE(isValid(ValueType::Payload, reference));
    EXPECT_FALSE(isValid(ValueType::SubLayer, payload));
    EXPECT_FALSE(
        isValid(ValueType::Payload, joined({text(std::string_view("\0", 1)), text(""), offset})));
    for (const auto& [type, bytes] : std::map<ValueType, Bytes>{{ValueType::Payload, payload},
                                                                {ValueType::Reference, reference},
                                                                {ValueType::SubLayer, subLayer}})
        for (std::size_t size = 0; size < bytes.size(); ++size)
            EXPECT_FALSE(isValid(type, Bytes(bytes.begin(), bytes.begin() + std::ptrdiff_t(size))));
}

TEST(Value, V8UnregisteredIsATextADictionaryOrAListOfItsKind) {
    EXPECT_TRUE(isValid(ValueType::Unregistered, joined({Bytes{0}, text("(1, 2)")})));
    EXPECT_TRUE(isValid(ValueType::Unregistered, unregisteredDictionary(2)));
    EXPECT_TRUE(isValid(ValueType::Unregistered, unregisteredLists(2)));
    EXPECT_FALSE(isValid(ValueType::Unregistered, joined({Bytes{3}, text("")})));
    EXPECT_FALSE(isValid(ValueType::Unregistered, {}));
    Bytes ofTokens = unregisteredLists(1);
    ofTokens[1] = std::uint8_t(ValueType::Token);
    EXPECT_FALSE(isValid(ValueType::Unregistered, ofTokens));
}

TEST(Value, V8NestsAtMost64Deep) {
    EXPECT_TRUE(isValid(ValueType::Unregistered, unregisteredDictionary(64)));
    EXPECT_FALSE(isValid(ValueType::Unregistered, unregisteredDictionary(65)));
    EXPECT_FALSE(isValid(ValueType::Unregistered, unregisteredDictionary(1'000)));
    EXPECT_TRUE(isValid(ValueType::Unregistered, unregisteredLists(64)));
    EXPECT_FALSE(isValid(ValueType::Unregistered, unregisteredLists(65)));
    EXPECT_FALSE(isValid(ValueType::Unregistered, unregisteredLists(1'000)));
}

TEST(Value, BuildersMakeProperValues) {
    for (const Value& value :
         {tokenValue("a"), stringValue("a longer text that is shared"), pathValue("/A.x"),
          pathValue(""), doubleValue(-0.5), boolValue(true), boolValue(false)})
        EXPECT_TRUE(validateValue(value.type(), value.bytes())) << typeName(value.type());
    EXPECT_EQ(textOf(tokenValue("")), "");
    const Value string = stringValue("a longer text that is shared"), path = pathValue("/A");
    EXPECT_EQ(textOf(string), "a longer text that is shared");
    EXPECT_EQ(textOf(path), "/A");
    EXPECT_EQ(textOf(doubleValue(1)), std::nullopt);
    EXPECT_EQ(textOf(Value(ValueType::Token, Bytes{9, 0, 0, 0})), std::nullopt);
    EXPECT_EQ(textOf(Value::blob(ValueType::String, Hash{}, 9)), std::nullopt);
    EXPECT_EQ(ByteReader(doubleValue(-0.5).bytes()).f64(), -0.5);
}

TEST(Value, V1ToV8RefusalsSayWhatIsWrong) {
    const auto refused =
        validateValue(arrayOf(ValueType::Bool), joined({numbers<std::uint64_t>({1}), {2}}));
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::InvalidValue);
    EXPECT_EQ(refused.error().message, "the value (Bool[]) holds a number its type does not have");
}

TEST(Value, V1ToV8RandomValuesOfEveryTypeAreAcceptedAndTheirBeginningsAreNot) {
    for (unsigned seed = 0; seed < 60; ++seed) {
        SCOPED_TRACE(seed);
        RandomValue random(seed);
        for (const auto type : allLeafTypes()) {
            const Bytes bytes = random.leafBytes(type);
            const auto checked = validateValue(type, bytes);
            ASSERT_TRUE(checked) << checked.error().message;
            ASSERT_FALSE(isValid(type, joined({bytes, {0}}))) << typeName(type);
            for (std::size_t size = 0; size < bytes.size(); ++size)
                ASSERT_FALSE(validateValue(type, ByteView(bytes).first(size))) << typeName(type);
        }
    }
}

// Nothing crashes; the sanitizers check all reads.
TEST(Value, V1ToV8AnyBytesAreAnsweredForEveryType) {
    std::mt19937 random(7);
    for (int round = 0; round < 300; ++round) {
        Bytes bytes(random() % 60);
        for (auto& byte : bytes) byte = std::uint8_t(random() % 3 ? random() % 4 : random());
        for (const auto type : allLeafTypes()) {
            const auto checked = validateValue(type, bytes);
            ASSERT_TRUE(checked || isUtf8(checked.error().message));
        }
    }
}
