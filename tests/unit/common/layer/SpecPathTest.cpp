// Tests paths of specs (PA1-PA3).
#include "usdlive/common/layer/SpecPath.h"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

using namespace usdlive;
using enum ChildList;

namespace {

using Elements = std::vector<PathElement>;

Elements parsed(std::string_view path) {
    const auto elements = specpath::parse(path);
    EXPECT_TRUE(elements) << elements.error().message;
    return elements.value_or(Elements{});
}

// Joins the elements from left to right.
std::string built(const Elements& elements, std::size_t count) {
    std::string path = "/";
    for (std::size_t index = 0; index < count; ++index)
        path = specpath::child(path, elements[index].list, elements[index].name);
    return path;
}
std::string built(const Elements& elements) { return built(elements, elements.size()); }

bool isPrefix(const Elements& ancestor, const Elements& path) {
    return ancestor.size() <= path.size() &&
           std::equal(ancestor.begin(), ancestor.end(), path.begin());
}

// Uses few and similar names, so that random paths often share a beginning or a part of a name.
class RandomPaths {
public:
    explicit RandomPaths(unsigned seed) : random_(seed) {}

    Elements next() { return below({}, 6); }

    Elements below(Elements path, unsigned most) {
        for (unsigned left = random_() % (most + 1); left > 0; --left)
            if (!extend(path)) break;
        return path;
    }

private:
    bool extend(Elements& path) {
        static constexpr std::string_view kNames[] = {"A", "AB", "B", "\xC3\xA4", "v"};
        static constexpr std::string_view kProperties[] = {"A", "A:B", "AB", "v:w:x"};
        static constexpr std::string_view kVariants[] = {"A", ".A", "A|-", "1", "."};
        const auto name = [&](const auto& names) { return names[random_() % std::size(names)]; };
        if (path.empty()) {
            path.push_back({Prims, name(kNames)});
            return true;
        }
        switch (path.back().list) {
            case Properties:
                return false;
            case VariantSets:
                path.push_back({Variants, name(kVariants)});
                return true;
            default:
                switch (random_() % 4) {
                    case 0:
                        path.push_back({Properties, name(kProperties)});
                        return true;
                    case 1:
                        path.push_back({VariantSets, name(kNames)});
                        return true;
                    default:
                        path.push_back({Prims, name(kNames)});
                        return true;
                }
        }
    }

    std::mt19937 random_;
};

}  // namespace

TEST(SpecPath, PA1SplitsPathsIntoTheirElements) {
    EXPECT_EQ(parsed("/"), Elements{});
    EXPECT_EQ(parsed("/A/B"), (Elements{{Prims, "A"}, {Prims, "B"}}));
    EXPECT_EQ(parsed("/A.x:y"), (Elements{{Prims, "A"}, {Properties, "x:y"}}));
    EXPECT_EQ(parsed("/A{v=}"), (Elements{{Prims, "A"}, {VariantSets, "v"}}));
    EXPECT_EQ(parsed("/A{v=one}"), (Elements{{Prims, "A"}, {VariantSets, "v"}, {Variants, "one"}}));
    EXPECT_EQ(parsed("/A{v=one}B.x:y"), (Elements{{Prims, "A"},
                                                  {VariantSets, "v"},
                                                  {Variants, "one"},
                                                  {Prims, "B"},
                                                  {Properties, "x:y"}}));
    EXPECT_EQ(parsed("/A{v=one}{w=two}C"), (Elements{{Prims, "A"},
                                                     {VariantSets, "v"},
                                                     {Variants, "one"},
                                                     {VariantSets, "w"},
                                                     {Variants, "two"},
                                                     {Prims, "C"}}));
    EXPECT_EQ(parsed("/A{v=one}.x").back(), (PathElement{Properties, "x"}));
    EXPECT_EQ(parsed("/A{v=one}B/C{w=}").back(), (PathElement{VariantSets, "w"}));
}

// The results were compared with Sdf.Path.IsValidPathString of usd-core 26.8, which accepts only
// the last group.
TEST(SpecPath, PA1RefusesPathsThatAddressNoSpec) {
    using namespace std::string_view_literals;
    for (const std::string_view path :
         {""sv, "//A"sv, "/A/"sv, "/A//B"sv, "/1A"sv, "/A-B"sv, "/A:B"sv, "/A B"sv, "/ A"sv,
          "/.x"sv, "/A."sv, "/A..x"sv, "/A.x.y"sv, "/A.x/B"sv, "/A.:x"sv, "/A.x:"sv, "/A.x::y"sv,
          "/A.1x"sv, "/A.x:1y"sv, "/A.x-y"sv, "/A.x{v=a}"sv, "/{v=}"sv, "/A{"sv, "/A{}"sv,
          "/A{v}"sv, "/A{v="sv, "/A{=}"sv, "/A{=a}"sv, "/A{1v=a}"sv, "/A{v:w=a}"sv, "/A{v|w=a}"sv,
          "/A{v=a.b}"sv, "/A{v=..a}"sv, "/A{v=a:b}"sv, "/A{v=a b}"sv, "/A{v=a=b}"sv, "/A{v=a{}"sv,
          "/A{v=a}}"sv, "/A}"sv, "/A{v=one}/B"sv, "/A{v=one}B{"sv, "/A{v=\xC2\xB2}"sv,
          "/\xC2\xA0"sv, "/A\xFF"sv, "/A\xED\xA0\x80"sv, "/A\0B"sv,
          // Sdf accepts these paths, but they address no spec in usdlive, or Sdf writes them
          // differently.
          "/A.r[/T]"sv, "/A.r[/T].x"sv, "/A{v=}B"sv, "/A{v=}.x"sv, "/A{v=}{w=a}"sv, "A"sv, "A/B"sv,
          "."sv, "../A"sv, "/A\nB"sv, "/A{v= one}"sv, "/A{v-w=a}"sv, "/A.x.mapper[/T]"sv,
          "/A.x.expression"sv}) {
        const auto elements = specpath::parse(path);
        ASSERT_FALSE(elements) << path;
        EXPECT_EQ(elements.error().code, ErrorCode::InvalidPath);
    }
}

TEST(SpecPath, PA1BoundsLengthAndElements) {
    const auto repeated = [](std::string_view text, std::size_t count) {
        std::string out;
        for (; count > 0; --count) out += text;
        return out;
    };
    EXPECT_EQ(parsed(repeated("/A", 1024)).size(), 1024U);
    EXPECT_FALSE(specpath::parse(repeated("/A", 1025)));
    EXPECT_FALSE(specpath::parse(repeated("/A", 1023) + "{v=one}"));
    EXPECT_TRUE(specpath::parse("/" + std::string(16 * 1024 - 1, 'A')));
    EXPECT_FALSE(specpath::parse("/" + std::string(16 * 1024, 'A')));
}

TEST(SpecPath, PA2NamesAreThoseOfOpenUsd) {
    for (const std::string_view name : {"A", "_", "a1", "\xC3\xA9", "\xE6\xBC\xA2"}) {
        for (const auto list : {Prims, Properties, VariantSets, Variants})
            EXPECT_TRUE(specpath::isName(list, name)) << name;
    }
    for (const auto list : {Prims, Properties, VariantSets, Variants})
        for (const std::string_view name :
             {"", " ", "a b", "a/b", "a.b", "a=b", "\xC2\xA0", "{", "a\n"})
            EXPECT_FALSE(specpath::isName(list, name)) << name;
    EXPECT_TRUE(specpath::isName(Properties, "a:b"));
    EXPECT_FALSE(specpath::isName(Prims, "a:b"));
    EXPECT_FALSE(specpath::isName(Variants, "a:b"));
    for (const std::string_view name : {"1", "-", ".", ".-", "|", "a-b", "\xC2\xB7"}) {
        EXPECT_TRUE(specpath::isName(Variants, name)) << name;
        EXPECT_FALSE(specpath::isName(Prims, name)) << name;
    }
}

TEST(SpecPath, ChildJoinsAsSdfWritesIt) {
    EXPECT_EQ(specpath::child("/", Prims, "A"), "/A");
    EXPECT_EQ(specpath::child("/A", Prims, "B"), "/A/B");
    EXPECT_EQ(specpath::child("/A", Properties, "x:y"), "/A.x:y");
    EXPECT_EQ(specpath::child("/A", VariantSets, "v"), "/A{v=}");
    EXPECT_EQ(specpath::child("/A{v=}", Variants, "one"), "/A{v=one}");
    EXPECT_EQ(specpath::child("/A{v=one}", Prims, "B"), "/A{v=one}B");
    EXPECT_EQ(specpath::child("/A{v=one}", Properties, "x"), "/A{v=one}.x");
    EXPECT_EQ(specpath::child("/A{v=one}", VariantSets, "w"), "/A{v=one}{w=}");
}

TEST(SpecPath, ParentGoesOneStepUp) {
    EXPECT_EQ(specpath::parent("/"), "");
    EXPECT_EQ(specpath::parent("/A"), "/");
    EXPECT_EQ(specpath::parent("/A/B"), "/A");
    EXPECT_EQ(specpath::parent("/A.x:y"), "/A");
    EXPECT_EQ(specpath::parent("/A{v=one}B"), "/A{v=one}");
    EXPECT_EQ(specpath::parent("/A{v=.a}B"), "/A{v=.a}");
    EXPECT_EQ(specpath::parent("/A{v=.a}"), "/A{v=}");
    EXPECT_EQ(specpath::parent("/A{v=}"), "/A");
    EXPECT_EQ(specpath::parent("/A{v=one}{w=}"), "/A{v=one}");
    EXPECT_EQ(specpath::parent("/A{v=one}.x"), "/A{v=one}");
}

TEST(SpecPath, HasPrefixGoesByElementsNotByLetters) {
    EXPECT_TRUE(specpath::hasPrefix("/", "/"));
    EXPECT_TRUE(specpath::hasPrefix("/A/B", "/"));
    EXPECT_TRUE(specpath::hasPrefix("/A/B", "/A"));
    EXPECT_TRUE(specpath::hasPrefix("/A.x", "/A"));
    EXPECT_TRUE(specpath::hasPrefix("/A{v=}", "/A"));
    EXPECT_TRUE(specpath::hasPrefix("/A{v=one}B", "/A{v=}"));
    EXPECT_TRUE(specpath::hasPrefix("/A{v=one}B", "/A{v=one}"));
    EXPECT_FALSE(specpath::hasPrefix("/", "/A"));
    EXPECT_FALSE(specpath::hasPrefix("/AB", "/A"));
    EXPECT_FALSE(specpath::hasPrefix("/A", "/A/B"));
    EXPECT_FALSE(specpath::hasPrefix("/A.x:y", "/A.x"));
    EXPECT_FALSE(specpath::hasPrefix("/A{v=one}", "/A{v=on}"));
    EXPECT_FALSE(specpath::hasPrefix("/A{vw=one}", "/A{v=}"));
    EXPECT_FALSE(specpath::hasPrefix("/A{v=}", "/A{v=one}"));
}

TEST(SpecPath, ReplacePrefixRespectsSeparators) {
    EXPECT_EQ(specpath::replacePrefix("/A/B.x", "/A", "/"), "/B.x");
    EXPECT_EQ(specpath::replacePrefix("/A/B.x", "/A", "/C/D"), "/C/D/B.x");
    EXPECT_EQ(specpath::replacePrefix("/A", "/A", "/C"), "/C");
    EXPECT_EQ(specpath::replacePrefix("/A/B", "/", "/C"), "/C/A/B");
    EXPECT_EQ(specpath::replacePrefix("/C/B.x", "/C", "/A{v=one}C"), "/A{v=one}C/B.x");
    EXPECT_EQ(specpath::replacePrefix("/A{v=one}C/B.x", "/A{v=one}C", "/C"), "/C/B.x");
    EXPECT_EQ(specpath::replacePrefix("/C/B", "/C", "/A{v=one}"), "/A{v=one}B");
    EXPECT_EQ(specpath::replacePrefix("/A{v=one}B", "/A{v=one}", "/C"), "/C/B");
    EXPECT_EQ(specpath::replacePrefix("/A{v=one}B", "/A{v=one}", "/"), "/B");
    EXPECT_EQ(specpath::replacePrefix("/A{v=one}.x", "/A{v=one}", "/C"), "/C.x");
    EXPECT_EQ(specpath::replacePrefix("/A{v=one}{w=two}", "/A{v=one}", "/C"), "/C{w=two}");
    EXPECT_EQ(specpath::replacePrefix("/A{v=one}B", "/A{v=one}", "/A{v=two}"), "/A{v=two}B");
    EXPECT_EQ(specpath::replacePrefix("/A{v=one}B.x", "/A{v=}", "/C{w=}"), "/C{w=one}B.x");
    EXPECT_EQ(specpath::replacePrefix("/A{v=}", "/A{v=}", "/C{w=}"), "/C{w=}");
    EXPECT_EQ(specpath::replacePrefix("/A{v=one}", "/A", "/B"), "/B{v=one}");
    EXPECT_EQ(specpath::replacePrefix("/A.x:y", "/A.x:y", "/B.z"), "/B.z");
}

// Compares operations on text with the same operations on lists of elements.
TEST(SpecPath, OperationsOnTextAgreeWithThoseOnElements) {
    for (unsigned seed = 0; seed < 5000; ++seed) {
        SCOPED_TRACE(seed);
        RandomPaths random(seed);
        const Elements elements = random.next();
        const std::string path = built(elements);
        ASSERT_EQ(parsed(path), elements) << path;
        if (elements.empty()) continue;

        ASSERT_EQ(specpath::parent(path), built(elements, elements.size() - 1)) << path;
        ASSERT_EQ(specpath::last(path), elements.back()) << path;
        for (std::size_t count = 0; count <= elements.size(); ++count)
            ASSERT_TRUE(specpath::hasPrefix(path, built(elements, count))) << path;

        const Elements other = random.next();
        ASSERT_EQ(specpath::hasPrefix(path, built(other)), isPrefix(other, elements))
            << path << " " << built(other);
    }
}

TEST(SpecPath, ReplacePrefixAgreesWithTheSameOnElements) {
    for (unsigned seed = 0; seed < 5000; ++seed) {
        SCOPED_TRACE(seed);
        RandomPaths random(seed);
        const Elements from = random.next(), to = random.next();
        if (from.empty() || to.empty() || from.back().list != to.back().list) continue;
        const Elements path = random.below(from, 4);
        Elements expected = to;
        expected.insert(expected.end(), path.begin() + std::ptrdiff_t(from.size()), path.end());
        ASSERT_EQ(specpath::replacePrefix(built(path), built(from), built(to)), built(expected));
    }
}

TEST(SpecPath, PA1AnyBytesAreRefusedOrEqualTheirJoinedElements) {
    static constexpr std::string_view kLetters[] = {"/", "A", "v", "{", "=",    "}",   ".",
                                                    ":", "1", "-", "|", "\xC3", "\xA4"};
    std::mt19937 random(1);
    int accepted = 0;
    for (int round = 0; round < 200'000; ++round) {
        std::string path = "/A";
        for (auto left = random() % 9; left > 0; --left)
            path += kLetters[random() % std::size(kLetters)];
        const auto elements = specpath::parse(path);
        if (!elements) continue;
        ++accepted;
        ASSERT_EQ(built(*elements), path);
    }
    EXPECT_GT(accepted, 1000);
}
