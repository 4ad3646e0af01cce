// Tests reading and printing .obj files, without OpenUSD.
#include "plugins/obj/ObjParser.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <random>

#include "plugins/obj/ObjText.h"

using namespace usdlive;

namespace {

const std::string kSquare = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

obj::Model parsed(const std::string& text, obj::Split split = {}) {
    auto result = obj::parse(text, split);
    if (const auto* error = std::get_if<obj::ParseError>(&result)) {
        ADD_FAILURE() << "line " << error->line << ": " << error->reason;
        return {};
    }
    return std::get<obj::Model>(std::move(result));
}

std::string refused(const std::string& text) {
    const auto result = obj::parse(text);
    const auto* error = std::get_if<obj::ParseError>(&result);
    return error ? std::to_string(error->line) + ": " + error->reason : "accepted";
}

std::vector<std::string> names(const obj::Model& model) {
    std::vector<std::string> found;
    for (const auto& part : model.parts) found.push_back(part.name);
    return found;
}

}  // namespace

TEST(ObjParser, ReadsEveryElement) {
    const auto model = parsed(
        "# comment \\\r\nmtllib a.mtl b.mtl\r\no Chair leg\r\n" + kSquare +
        "v 5 5 5 1.0\nv 6 6 6 .5 +0.25 1e-1\nv 7 7 7 1 0 1 0\nvt .5\nvt 1 1 0.25\nvn 0 0 -1\n"
        "s 1\nusemtl Red wood # comment\nf 1/1/1 2/2/1 -5//1 \\\n 4\nf 1 2 3\nl 1 2/1 3\np 7 6\n");
    EXPECT_EQ(model.materialLibraries, (std::vector<std::string>{"a.mtl", "b.mtl"}));
    EXPECT_EQ(model.materials, std::vector<std::string>{"Red wood"});
    ASSERT_EQ(model.points.size(), 7U);
    EXPECT_EQ(model.points[5], (obj::Vec3{6, 6, 6}));
    EXPECT_EQ(model.colors[5], (obj::Vec3{0.5F, 0.25F, 0.1F}));
    EXPECT_EQ(model.colors[6], (obj::Vec3{0, 1, 0}));
    EXPECT_EQ(model.isColored, (std::vector<bool>{false, false, false, false, false, true, true}));
    EXPECT_EQ(model.texCoords, (std::vector<obj::Vec3>{{0.5F, 0, 0}, {1, 1, 0.25F}}));
    EXPECT_EQ(model.normals, (std::vector<obj::Vec3>{{0, 0, -1}}));
    ASSERT_EQ(names(model), std::vector<std::string>{"Chair leg"});
    const auto& part = model.parts[0];
    EXPECT_EQ(part.faceCounts, (std::vector<int>{4, 3}));
    EXPECT_EQ(part.corners[0], (obj::Corner{0, 0, 0}));
    EXPECT_EQ(part.corners[2], (obj::Corner{2, -1, 0}));
    EXPECT_EQ(part.corners[3], (obj::Corner{3, -1, -1}));
    EXPECT_EQ(part.faceMaterials, (std::vector<int>{0, 0}));
    EXPECT_EQ(part.lineCounts, std::vector<int>{3});
    EXPECT_EQ(part.points, (std::vector<int>{6, 5}));
}

TEST(ObjParser, NegativeIndicesCountFromTheLatestElement) {
    const auto model = parsed("v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 2 2 2\nf -3 -2 -1\n");
    EXPECT_EQ(model.parts[0].corners[0].point, 0);
    EXPECT_EQ(model.parts[0].corners[3].point, 1);
}

TEST(ObjParser, ElementsMayComeBeforeWhatTheyUse) {
    EXPECT_EQ(parsed("f 1 2 3\n" + kSquare).parts.size(), 1U);
    EXPECT_EQ(refused("v 0 0 0\nf 1 1 1\n\nf 1 2 1\nf 1 1 1\n"),
              "4: uses vertex 2, and the file has 1");
}

TEST(ObjParser, SplitsIntoPartsAsAsked) {
    const std::string faces = "f 1 2 3\n";
    const std::string text = kSquare + "g early\n" + faces + "o A\n" + faces + "g one\n" + faces +
                             "g two\n" + faces + "o B\n" + faces + "g one\n" + faces + "o A\n" +
                             faces;
    using Names = std::vector<std::string>;
    EXPECT_EQ(names(parsed(text)), (Names{"", "A", "B"}));
    EXPECT_EQ(parsed(text).parts[1].faceCounts.size(), 4U) << "a name that comes again continues";
    EXPECT_EQ(names(parsed(text, obj::Split::Groups)),
              (Names{"early", "A", "one", "two", "B", "one"}));
    EXPECT_EQ(names(parsed(text, obj::Split::None)), Names{""});
    EXPECT_EQ(names(parsed(kSquare + "g a b\n" + faces + "g\n" + faces)), (Names{"a b", ""}));
    EXPECT_EQ(names(parsed("o empty\n" + kSquare)), Names{});
}

TEST(ObjParser, NamesBecomeUtf8) {
    EXPECT_EQ(names(parsed(kSquare + "o St\xC3\xBChl\nf 1 2 3\n")),
              std::vector<std::string>{"St\xC3\xBChl"});
    EXPECT_EQ(names(parsed(kSquare + "o St\xFChl \xED\xA0\x80\x01|\nf 1 2 3\n")),
              std::vector<std::string>{"St\xEF\xBF\xBDhl \xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD_|"});
}

TEST(ObjParser, RefusesWithLineAndReason) {
    EXPECT_EQ(refused("v 0 0 0\n\n# three\nv 1 2\n"), "4: 'v' needs 3 numbers, and has 2");
    EXPECT_EQ(refused("v 0 0 \\\n 0\nv x 0 0\n"), "3: 'x' is no number, or too large");
    EXPECT_EQ(refused("v nan 0 0\n"), "1: 'nan' is no number, or too large");
    EXPECT_EQ(refused("v 1e39 0 0\n"), "1: '1e39' is no number, or too large");
    EXPECT_EQ(refused("v 0 0 0 0 0\n"),
              "1: 'v' with 5 numbers: expected x y z, x y z w or x y z r g b");
    EXPECT_EQ(refused("v 0 0 0 0.5\n"), "1: 'v' has a weight, which only free-form geometry uses");
    EXPECT_EQ(refused("vn 0 0 0 0\n"), "1: 'vn' has more than 3 numbers");
    EXPECT_EQ(refused("f 1 1\n"), "1: 'f' needs three or more corners, and has 2");
    EXPECT_EQ(refused("f 0 1 2\n"), "1: the index 0 in '0': indices begin at 1");
    EXPECT_EQ(refused("v 0 0 0\nf 1 -2 1\n"), "2: the index in '-2' is out of range");
    EXPECT_EQ(refused("f 1 99999999999 1\n"), "1: the index in '99999999999' is out of range");
    EXPECT_EQ(refused("f 1 1/x 1\n"), "1: '1/x' is no index");
    EXPECT_EQ(refused("f 1/1/1/1 1 1\n"), "1: '1/1/1/1' is no index");
    EXPECT_EQ(refused(kSquare + "f 1/1 2 3\n"), "5: uses texture coordinate 1, and the file has 0");
    EXPECT_EQ(refused(kSquare + "f 1//2 2 3\n"), "5: uses normal 2, and the file has 0");
    EXPECT_EQ(refused("l 1\n"), "1: 'l' needs two or more points, and has 1");
    EXPECT_EQ(refused("p\n"), "1: 'p' needs a point");
    EXPECT_EQ(refused("usemtl\n"), "1: 'usemtl' needs a name");
    EXPECT_EQ(refused("\ncurv 0 1\n"), "2: 'curv': free-form geometry is not supported");
    EXPECT_EQ(refused("solid cube\n"), "1: unknown statement 'solid'");
    EXPECT_EQ(refused(std::string("\0\1\2", 3)), "1: unknown statement '___'");
    EXPECT_EQ(refused(""), "accepted");
}

TEST(ObjParser, RecognizesTheFormat) {
    EXPECT_TRUE(obj::looksLikeObj("# Blender\n\nmtllib a.mtl\n"));
    EXPECT_TRUE(obj::looksLikeObj(""));
    EXPECT_FALSE(obj::looksLikeObj("#usda 1.0\n(\n"));
    EXPECT_FALSE(obj::looksLikeObj("PXR-USDC"));
}

// Prints random models and reads them again.
TEST(ObjText, IsReadAsTheSameModel) {
    for (unsigned seed = 0; seed < 200; ++seed) {
        SCOPED_TRACE(seed);
        std::mt19937 random(seed);
        const auto below = [&](int limit) { return int(random() % unsigned(limit)); };
        const auto any = [&] {
            // All floats, from their bits, except infinities and NaN.
            float value = 0;
            do {
                const std::uint32_t bits = random();
                std::memcpy(&value, &bits, sizeof value);
            } while (!std::isfinite(value));
            return value;
        };
        obj::Model model;
        const bool isColored = below(2) == 0;
        for (int at = 0; at < 1 + below(20); ++at) {
            model.points.push_back({any(), any(), any()});
            if (!isColored) continue;
            model.isColored.push_back(at == 0 || below(2) == 0);
            model.colors.push_back(model.isColored.back() ? obj::Vec3{any(), any(), any()}
                                                          : obj::Vec3{1, 1, 1});
        }
        for (int at = below(5); at > 0; --at) model.texCoords.push_back({any(), any(), any()});
        for (int at = below(5); at > 0; --at) model.normals.push_back({any(), any(), any()});
        const auto index = [&](std::size_t count) {
            return count == 0 || below(3) == 0 ? -1 : below(int(count));
        };
        for (int part = below(4); part > 0; --part) {
            auto& into = model.parts.emplace_back();
            into.name = "part " + std::to_string(part);
            const int faces = below(4);
            if (faces > 0 && model.materials.size() < 3)
                model.materials.push_back("material " + std::to_string(model.materials.size()));
            for (int face = 0; face < faces; ++face) {
                into.faceCounts.push_back(3 + below(3));
                into.faceMaterials.push_back(int(model.materials.size()) - 1);
                for (int corner = 0; corner < into.faceCounts.back(); ++corner)
                    into.corners.push_back({below(int(model.points.size())),
                                            index(model.texCoords.size()),
                                            index(model.normals.size())});
            }
            for (int lines = below(3); lines > 0; --lines) {
                into.lineCounts.push_back(2 + below(3));
                for (int at = 0; at < into.lineCounts.back(); ++at)
                    into.linePoints.push_back(below(int(model.points.size())));
            }
            for (int at = 1 + below(3); at > 0; --at)
                into.points.push_back(below(int(model.points.size())));
        }
        EXPECT_EQ(parsed(obj::print(model, "a comment\nof two lines")), model);
    }
}
