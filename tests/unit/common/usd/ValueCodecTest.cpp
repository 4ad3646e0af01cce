// Tests the conversion of USD values to bytes and back.
#include "usdlive/common/usd/ValueCodec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pxr/base/gf/half.h>
#include <pxr/base/gf/quath.h>
#include <pxr/base/gf/range1d.h>
#include <pxr/base/tf/enum.h>
#include <pxr/base/tf/token.h>
#include <pxr/base/ts/spline.h>
#include <pxr/base/vt/array.h>
#include <pxr/base/vt/arrayEdit.h>
#include <pxr/base/vt/arrayEditBuilder.h>
#include <pxr/base/vt/dictionary.h>
#include <pxr/base/vt/value.h>
#include <pxr/usd/sdf/assetPath.h>
#include <pxr/usd/sdf/layerOffset.h>
#include <pxr/usd/sdf/listOp.h>
#include <pxr/usd/sdf/opaqueValue.h>
#include <pxr/usd/sdf/path.h>
#include <pxr/usd/sdf/pathExpression.h>
#include <pxr/usd/sdf/payload.h>
#include <pxr/usd/sdf/reference.h>
#include <pxr/usd/sdf/schema.h>
#include <pxr/usd/sdf/types.h>

#include <limits>
#include <random>

#include "MemoryBlobs.h"

using namespace usdlive;
using namespace usdlive::usd;
using namespace pxr;
using testing::HasSubstr;
using usdlive::test::MemoryBlobs;

namespace {

const TfToken kNoField;

std::vector<std::uint8_t> bytesOf(const FieldValue& value) {
    const auto bytes = value.as<Value>()->bytes();
    return {bytes.begin(), bytes.end()};
}

FieldValue encoded(const VtValue& value, MemoryBlobs& blobs) {
    auto field = encodeValue(value, blobs);
    EXPECT_TRUE(field) << value.GetTypeName() << ": " << (field ? "" : field.error().message);
    return field ? *field : FieldValue();
}

// Encodes and decodes: the C++ type, the content and the bytes must stay the same.
void expectRoundTrip(const VtValue& value, const TfToken& field = kNoField) {
    SCOPED_TRACE(value.GetTypeName());
    MemoryBlobs blobs;
    const FieldValue there = encoded(value, blobs);
    const auto sent = decodeFieldValue(encodeFieldValue(there));
    ASSERT_TRUE(sent) << sent.error().message;
    EXPECT_EQ(*sent, there);
    const auto back = decodeValue(field, *sent, blobs);
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(back->GetTypeName(), value.GetTypeName());
    EXPECT_EQ(encoded(*back, blobs), there);
    // A NaN differs from itself, but its bytes were compared.
    std::string text = TfStringify(value);
    if (text.find("nan") == std::string::npos) {
        EXPECT_EQ(*back, value);
    }
}

ErrorCode codeOf(const VtValue& value) {
    MemoryBlobs blobs;
    const auto field = encodeValue(value, blobs);
    EXPECT_FALSE(field);
    return field ? ErrorCode{} : field.error().code;
}

ErrorCode decodeError(const FieldValue& value) {
    MemoryBlobs blobs;
    const auto decoded = decodeValue(kNoField, value, blobs);
    EXPECT_FALSE(decoded);
    return decoded ? ErrorCode{} : decoded.error().code;
}

Value text(ValueType type, std::string_view content) {
    const Value string = stringValue(content);
    return {type, string.bytes()};
}

// Returns some value of each type; numbers are any bits, text is text.
template <class T>
T sample(std::mt19937& random) {
    if constexpr (std::is_same_v<T, bool>) {
        return random() % 2 == 0;
    } else if constexpr (std::is_same_v<T, std::string>) {
        return "t\u00e9xt " + std::to_string(random());
    } else if constexpr (std::is_same_v<T, TfToken>) {
        return TfToken("token" + std::to_string(random() % 9));
    } else if constexpr (std::is_same_v<T, SdfAssetPath>) {
        return SdfAssetPath("./a b/\u4e16." + std::to_string(random() % 9) + ".usd");
    } else if constexpr (std::is_same_v<T, SdfPathExpression>) {
        return SdfPathExpression("/A//foo* - /B{isa:\"x\"} %_");
    } else if constexpr (std::is_same_v<T, SdfOpaqueValue>) {
        return T();
    } else {
        T value;
        std::uint8_t bytes[sizeof(T)];
        for (auto& byte : bytes) byte = std::uint8_t(random());
        std::memcpy(static_cast<void*>(&value), bytes, sizeof value);
        return value;
    }
}

template <class T>
void expectValueType(std::mt19937& random) {
    expectRoundTrip(VtValue(sample<T>(random)));
    if constexpr (!std::is_same_v<T, SdfOpaqueValue>) {
        expectRoundTrip(VtValue(VtArray<T>()));
        const VtArray<T> array{sample<T>(random), sample<T>(random), sample<T>(random)};
        expectRoundTrip(VtValue(array));
        expectRoundTrip(VtValue(VtArrayEdit<T>()));
        VtArrayEditBuilder<T> builder;
        builder.Write(sample<T>(random), 1).Append(sample<T>(random)).EraseRef(0).MinSize(4);
        builder.PrependRef(2).SetSize(7, sample<T>(random)).MaxSize(30);
        expectRoundTrip(VtValue(builder.FinalizeAndReset()));
    }
}

template <class T>
SdfListOp<T> listOp(const std::vector<T>& items) {
    SdfListOp<T> op;
    op.SetPrependedItems({items[0], items[1]});
    op.SetAppendedItems({items[2]});
    op.SetDeletedItems({items[0]});
    op.SetAddedItems({items[1], items[2]});
    op.SetOrderedItems({items[2], items[1]});
    return op;
}

template <class T>
void expectListOps(const std::vector<T>& items) {
    expectRoundTrip(VtValue(listOp(items)));
    expectRoundTrip(VtValue(SdfListOp<T>::CreateExplicit(items)));
    expectRoundTrip(VtValue(SdfListOp<T>::CreateExplicit()));
    expectRoundTrip(VtValue(SdfListOp<T>()));
}

}  // namespace

TEST(ValueCodec, EveryValueTypeOfSdfComesBackExactly) {
    for (unsigned seed = 0; seed < 50; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random{seed};
#define EXPECT_VALUE_TYPE(unused, elem) expectValueType<SDF_VALUE_CPP_TYPE(elem)>(random);
        TF_PP_SEQ_FOR_EACH(EXPECT_VALUE_TYPE, ~, SDF_VALUE_TYPES)
#undef EXPECT_VALUE_TYPE
    }
}

TEST(ValueCodec, BytesAreAsTheProtocolSays) {
    MemoryBlobs blobs;
    using Expected = std::vector<std::uint8_t>;
    EXPECT_EQ(bytesOf(encoded(VtValue(true), blobs)), Expected{1});
    EXPECT_EQ(bytesOf(encoded(VtValue(GfQuath(1, 2, 3, 4)), blobs)),
              (Expected{0, 0x40, 0, 0x42, 0, 0x44, 0, 0x3c}));  // i, j, k, real
    EXPECT_EQ(bytesOf(encoded(VtValue(VtArray<bool>{true, false, true}), blobs)),
              (Expected{3, 0, 0, 0, 0, 0, 0, 0, 1, 0, 1}));
    EXPECT_EQ(bytesOf(encoded(VtValue(VtArray<std::string>{"a", ""}), blobs)),
              (Expected{2, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 'a', 0, 0, 0, 0}));
    EXPECT_EQ(bytesOf(encoded(VtValue(SdfPath("/A.b")), blobs)),
              (Expected{4, 0, 0, 0, '/', 'A', '.', 'b'}));
    EXPECT_EQ(bytesOf(encoded(VtValue(SdfPath()), blobs)), (Expected{0, 0, 0, 0}));
    GfMatrix2d matrix(1, 2, 3, 4);
    const auto bytes = bytesOf(encoded(VtValue(matrix), blobs));
    double second = 0;
    std::memcpy(&second, bytes.data() + 8, 8);
    EXPECT_EQ(second, 2);  // row major
}

TEST(ValueCodec, SignOfZeroAndNansKeepTheirBits) {
    MemoryBlobs blobs;
    const std::uint64_t nanBits = 0xfff8'0000'dead'beefU;
    double nan = 0;
    std::memcpy(&nan, &nanBits, 8);
    for (const double number : {-0.0, nan, std::numeric_limits<double>::denorm_min()}) {
        const auto field = encoded(VtValue(number), blobs);
        const auto back = decodeValue(kNoField, field, blobs)->UncheckedGet<double>();
        EXPECT_EQ(std::memcmp(&back, &number, 8), 0);
    }
}

TEST(ValueCodec, OtherTypesOfFieldsComeBack) {
    expectRoundTrip(VtValue(SdfSpecifierClass));
    expectRoundTrip(VtValue(SdfVariabilityUniform));
    expectRoundTrip(VtValue(SdfPermissionPrivate));
    expectRoundTrip(VtValue(TfTokenVector{TfToken("a"), TfToken()}));
    expectRoundTrip(VtValue(std::vector<std::string>{"a", "b", "b"}));
    expectRoundTrip(VtValue(SdfPath("/A{v=one}B.c")));
    expectRoundTrip(VtValue(SdfValueBlock()));
    expectRoundTrip(VtValue(SdfAnimationBlock()));
    expectRoundTrip(VtValue(SdfLayerOffset(-1.5, 2)));
    expectRoundTrip(VtValue(SdfPayload("a.usd", SdfPath("/P"), SdfLayerOffset(1, -1))));
    expectRoundTrip(
        VtValue(SdfReference("", SdfPath(), SdfLayerOffset(), VtDictionary{{"a:b", VtValue(1)}})));
    expectRoundTrip(VtValue(TfEnum(SdfLengthUnitMeter)), SdfFieldKeys->DisplayUnit);
}

TEST(ValueCodec, ListOpsOfEveryItemTypeComeBack) {
    expectListOps<int>({3, -1, 2});
    expectListOps<unsigned int>({3, 1, 2});
    expectListOps<std::int64_t>({3, -1, 2});
    expectListOps<std::uint64_t>({3, 1, 2});
    expectListOps<TfToken>({TfToken("a"), TfToken("b"), TfToken("c")});
    expectListOps<std::string>({"a", "b", ""});
    expectListOps<SdfPath>({SdfPath("/A"), SdfPath("/B.c"), SdfPath()});
    expectListOps<SdfReference>(
        {SdfReference("a.usd"), SdfReference("b.usd", SdfPath("/A")),
         SdfReference("", SdfPath("/C"), SdfLayerOffset(1, 2), VtDictionary{{"k", VtValue(1.5)}})});
    expectListOps<SdfPayload>(
        {SdfPayload("a.usd"), SdfPayload("b.usd", SdfPath("/A")), SdfPayload()});
    expectListOps<SdfUnregisteredValue>({SdfUnregisteredValue("a"), SdfUnregisteredValue("b"),
                                         SdfUnregisteredValue(VtDictionary{{"x", VtValue(2)}})});
}

TEST(ValueCodec, DictionariesComeBackWithAllTheyHold) {
    const VtDictionary inner{
        {"", VtValue(1)}, {"a:b", VtValue("c")}, {"empty", VtValue(VtDictionary())}};
    VtDictionary outer{{"inner", VtValue(inner)},
                       {"array", VtValue(VtArray<GfVec3f>{{1, 2, 3}, {4, 5, 6}})},
                       {"expression", VtValue(SdfPathExpression("//x"))},
                       {"opaque", VtValue(SdfOpaqueValue())},
                       {"asset", VtValue(SdfAssetPath("x.png"))},
                       {"unicode \u00e9", VtValue(GfHalf(0.5f))}};
    expectRoundTrip(VtValue(outer));
    expectRoundTrip(VtValue(VtDictionary()));
}

TEST(ValueCodec, DictionariesNestedTooDeepAreRefused) {
    VtDictionary nested{{"leaf", VtValue(1)}};
    for (std::size_t depth = 1; depth < kMaxNesting; ++depth)
        nested = VtDictionary{{"d", VtValue(nested)}};
    expectRoundTrip(VtValue(nested));
    nested = VtDictionary{{"d", VtValue(nested)}};
    EXPECT_EQ(codeOf(VtValue(nested)), ErrorCode::UnsupportedValue);
    EXPECT_EQ(codeOf(VtValue(SdfReference("", SdfPath(), SdfLayerOffset(), nested))),
              ErrorCode::UnsupportedValue);
}

TEST(ValueCodec, TimeSamplesComeBack) {
    SdfTimeSampleMap samples{{-1.5, VtValue(1.0)},
                             {0, VtValue(SdfValueBlock())},
                             {2, VtValue(VtArray<int>{1, 2})},
                             {1e300, VtValue(TfToken("t"))}};
    expectRoundTrip(VtValue(samples));
    expectRoundTrip(VtValue(SdfTimeSampleMap()));
    samples[std::numeric_limits<double>::infinity()] = VtValue(1.0);
    EXPECT_EQ(codeOf(VtValue(samples)), ErrorCode::UnsupportedValue);
}

TEST(ValueCodec, MapsComeBackAsTheTypeTheirFieldHas) {
    expectRoundTrip(VtValue(SdfVariantSelectionMap{{"look", "red"}, {"size", ""}}));
    expectRoundTrip(VtValue(SdfRelocates{{SdfPath("/B"), SdfPath("/A")}, {SdfPath("/A/C"), {}}}),
                    SdfFieldKeys->LayerRelocates);
    expectRoundTrip(VtValue(SdfRelocatesMap{{SdfPath("/A/B"), SdfPath("/A/C")}}),
                    SdfFieldKeys->Relocates);
    EXPECT_EQ(codeOf(VtValue(SdfRelocates{{SdfPath("/B"), SdfPath("/A")}, {SdfPath("/B"), {}}})),
              ErrorCode::UnsupportedValue);
}

TEST(ValueCodec, SplinesComeBack) {
    TsSpline spline(TfType::Find<double>());
    for (int time = 0; time < 3; ++time) {
        TsTypedKnot<double> knot;
        knot.SetTime(time);
        knot.SetValue(time * 1.5);
        knot.SetPostTanWidth(0.25);
        knot.SetNextInterpolation(TsInterpCurve);
        if (time == 1) knot.SetCustomDataByKey("note:why", VtValue("because"));
        spline.SetKnot(knot);
    }
    expectRoundTrip(VtValue(spline));
    expectRoundTrip(VtValue(TsSpline(TfType::Find<float>())));
    expectRoundTrip(VtValue(TsSpline()));
}

TEST(ValueCodec, UnregisteredValuesComeBack) {
    expectRoundTrip(VtValue(SdfUnregisteredValue("text")));
    expectRoundTrip(VtValue(SdfUnregisteredValue(VtDictionary{{"a", VtValue(VtDictionary())}})));
    const auto list = SdfUnregisteredValueListOp::CreateExplicit({SdfUnregisteredValue("x")});
    expectRoundTrip(VtValue(SdfUnregisteredValue(list)));
    EXPECT_EQ(codeOf(VtValue(SdfUnregisteredValue())), ErrorCode::UnsupportedValue);
}

TEST(ValueCodec, V9BigLeavesBecomeBlobs) {
    MemoryBlobs blobs;
    constexpr std::size_t kElements = (kBigValueBytes - sizeof(std::uint64_t)) / sizeof(double);
    const VtArray<double> below(kElements - 1, 1.5), big(kElements, 1.5);
    EXPECT_FALSE(encoded(VtValue(below), blobs).as<Value>()->isBlob());
    const auto field = encoded(VtValue(big), blobs);
    const Value& value = *field.as<Value>();
    ASSERT_TRUE(value.isBlob());
    EXPECT_EQ(value.size(), kBigValueBytes);
    EXPECT_EQ(value.hash(), sha256(*blobs.all.at(value.hash())));
    EXPECT_EQ(*decodeValue(kNoField, field, blobs), VtValue(big));

    EXPECT_TRUE(encoded(VtValue(std::string(kBigValueBytes, 'x')), blobs).as<Value>()->isBlob());
    expectRoundTrip(VtValue(VtDictionary{{"k", VtValue(big)}}));
    expectRoundTrip(VtValue(SdfTimeSampleMap{{1, VtValue(big)}}));
    // The value stays inline where the protocol allows no blobs.
    expectRoundTrip(VtValue(SdfReference("", SdfPath(), SdfLayerOffset(), {{"k", VtValue(big)}})));

    EXPECT_EQ(decodeError(field), ErrorCode::BlobNotFound);
    blobs.all[value.hash()] = std::make_shared<const Bytes>(kBigValueBytes, std::uint8_t(7));
    const auto damaged = decodeValue(kNoField, field, blobs);
    ASSERT_FALSE(damaged);
    EXPECT_EQ(damaged.error().code, ErrorCode::InvalidValue);
}

TEST(ValueCodec, V9ArraysShareTheMemoryOfTheirBlob) {
    MemoryBlobs blobs;
    const auto field = encoded(VtValue(VtArray<GfVec3f>(100'000, GfVec3f(1, 2, 3))), blobs);
    SharedBytes& kept = blobs.all.at(field.as<Value>()->hash());
    auto value = *decodeValue(kNoField, field, blobs);
    const auto array = value.Remove<VtArray<GfVec3f>>();
    EXPECT_EQ(static_cast<const void*>(array.cdata()), kept->data() + sizeof(std::uint64_t));
    // Writing to an array makes a private copy.
    auto changed = array;
    changed[7] = GfVec3f(0);
    EXPECT_EQ(array[7], GfVec3f(1, 2, 3));
    EXPECT_EQ(*decodeValue(kNoField, field, blobs), VtValue(array));
    const std::weak_ptr<const Bytes> memory = kept;
    kept = nullptr;
    EXPECT_FALSE(memory.expired());
    EXPECT_EQ(array.back(), GfVec3f(1, 2, 3));
}

TEST(ValueCodec, V9ArraysReleaseTheMemoryOfTheirBlob) {
    MemoryBlobs blobs;
    const auto field = encoded(VtValue(VtArray<double>(100'000, 1.5)), blobs);
    const std::weak_ptr<const Bytes> memory = blobs.all.at(field.as<Value>()->hash());
    auto value = *decodeValue(kNoField, field, blobs);
    blobs.all.clear();
    auto other = value;
    value = VtValue();
    EXPECT_FALSE(memory.expired());
    other = VtValue();
    EXPECT_TRUE(memory.expired());
}

TEST(ValueCodec, UnsupportedTypesAreNamed) {
    MemoryBlobs blobs;
    const auto range = encodeValue(VtValue(VtArray<GfRange1d>(1)), blobs);
    ASSERT_FALSE(range);
    EXPECT_EQ(range.error().code, ErrorCode::UnsupportedValue);
    EXPECT_THAT(range.error().message, HasSubstr("GfRange1d"));
    const auto nested =
        encodeValue(VtValue(VtDictionary{{"some", VtValue(GfRange1d(0, 1))}}), blobs);
    ASSERT_FALSE(nested);
    EXPECT_THAT(nested.error().message, HasSubstr("some"));
    EXPECT_EQ(codeOf(VtValue()), ErrorCode::UnsupportedValue);
    EXPECT_EQ(codeOf(VtValue(std::string("\xff"))), ErrorCode::UnsupportedValue);
    EXPECT_EQ(codeOf(VtValue(VtArray<SdfOpaqueValue>(2))), ErrorCode::UnsupportedValue);
    EXPECT_EQ(codeOf(VtValue(VtDictionary{{"none", VtValue()}})), ErrorCode::UnsupportedValue);
    EXPECT_EQ(codeOf(VtValue(VtDictionary{{"\xff", VtValue(1)}})), ErrorCode::UnsupportedValue);
    EXPECT_EQ(codeOf(VtValue(TfTokenVector{TfToken("\xff")})), ErrorCode::UnsupportedValue);
    EXPECT_EQ(codeOf(VtValue(SdfPath("../B"))), ErrorCode::UnsupportedValue);
    EXPECT_EQ(codeOf(VtValue(SdfRelocates{{SdfPath("B"), SdfPath("C")}})),
              ErrorCode::UnsupportedValue);
    EXPECT_EQ(codeOf(VtValue(SdfStringListOp::CreateExplicit({"\xff"}))),
              ErrorCode::UnsupportedValue);
}

TEST(ValueCodec, InvalidUnitsAreRefused) {
    MemoryBlobs blobs;
    for (const char* unit : {"", "cubits"})
        EXPECT_FALSE(decodeValue(SdfFieldKeys->DisplayUnit, tokenValue(unit), blobs)) << unit;
}

TEST(ValueCodec, ValuesThatThisOpenUsdCannotHoldAreRefusedSilently) {
    testing::internal::CaptureStderr();
    EXPECT_EQ(decodeError(text(ValueType::Path, "/A//B")), ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(text(ValueType::Path, "/A{v= one}")), ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(text(ValueType::Path, "../B")), ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(text(ValueType::Path, ".")), ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(text(ValueType::Asset, "a\nb")), ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(text(ValueType::PathExpression, "// [")), ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(text(ValueType::PathExpression, "/A&/B")), ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(Value(ValueType::Double, Bytes{1, 2})), ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(Value(ValueType::Bool, Bytes{2})), ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(Value(ValueType(999), Bytes{})), ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(Value(ValueType::Spline, Bytes{2, 0, 0, 0, 9, 9, 0, 0, 0, 0})),
              ErrorCode::InvalidValue);
    // Custom data at a time without knots.
    EXPECT_EQ(decodeError(Value(ValueType::Spline,
                                Bytes{0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0})),
              ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(FieldValue(ListOp{ValueType::Double, false, {}})),
              ErrorCode::InvalidValue);
    EXPECT_EQ(decodeError(FieldValue(Map{ValueType::Token, {}})), ErrorCode::InvalidValue);
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

// Bytes from an untrusted peer: valid bytes with a few changes.
TEST(ValueCodec, DamagedBytesNeverDoHarm) {
    testing::internal::CaptureStderr();
    MemoryBlobs blobs;
    TsSpline spline(TfType::Find<double>());
    TsTypedKnot<double> first, second;
    second.SetTime(2);
    second.SetNextInterpolation(TsInterpCurve);
    spline.SetKnot(first);
    spline.SetKnot(second);
    spline.SetInnerLoopParams({0, 2, 3, 3, 1.0});
    VtArrayEditBuilder<std::string> edit;
    edit.Append("x").SetSize(3, "y").EraseRef(-1);
    const std::vector<VtValue> values{
        VtValue(spline),
        VtValue(edit.FinalizeAndReset()),
        VtValue(VtArray<TfToken>{TfToken("a"), TfToken("b")}),
        VtValue(VtArray<GfVec3f>{{1, 2, 3}}),
        VtValue(SdfReference("a.usd", SdfPath("/A"), SdfLayerOffset(),
                             {{"k", VtValue(VtDictionary())}})),
        VtValue(SdfUnregisteredValue(
            SdfUnregisteredValueListOp::CreateExplicit({SdfUnregisteredValue("x")}))),
        VtValue(SdfPathExpression("/A//b{x:1}")),
        VtValue(TfTokenVector{TfToken("a")}),
    };
    for (unsigned seed = 0; seed < 20'000; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random{seed};
        const Value good = *encodeLeaf(values[random() % values.size()], blobs);
        Bytes bytes(good.bytes().begin(), good.bytes().end());
        for (int changes = 0; changes < 3; ++changes)
            bytes[random() % bytes.size()] = std::uint8_t(random() % 4 ? random() % 8 : random());
        if (random() % 8 == 0) bytes.resize(random() % bytes.size());
        const auto back = decodeLeaf(Value(good.type(), std::move(bytes)), blobs);
        if (!back) continue;
        TfStringify(*back);  // reads all of it
        double number = 0;
        if (back->IsHolding<TsSpline>())
            for (const double time : {-1e9, 0.0, 0.5, 7.0})
                back->UncheckedGet<TsSpline>().Eval(time, &number);
    }
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}
