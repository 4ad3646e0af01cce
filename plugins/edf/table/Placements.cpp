// Reads the placements of a table, and says what is wrong with a row.
#include "Placements.h"

#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/tf/unicodeUtils.h>
#include <pxr/usd/sdf/path.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "Csv.h"

namespace usdlive::edf::table {

namespace {

// Refers to the numbers of one placement.
std::map<std::string_view, double*> numbersOf(Placement& row) {
    return {{"x", &row.translate[0]},    {"y", &row.translate[1]},    {"z", &row.translate[2]},
            {"rotateX", &row.rotate[0]}, {"rotateY", &row.rotate[1]}, {"rotateZ", &row.rotate[2]},
            {"scaleX", &row.scale[0]},   {"scaleY", &row.scale[1]},   {"scaleZ", &row.scale[2]}};
}

std::map<std::string_view, std::string*> textsOf(Placement& row) {
    return {{"name", &row.name}, {"asset", &row.asset}, {"prim", &row.prim}};
}

std::optional<double> finite(const std::string& text) {
    double number = 0;
    const auto* end = text.data() + text.size();
    const auto [at, error] = std::from_chars(text.data(), end, number);
    if (error != std::errc() || at != end || !std::isfinite(number)) return std::nullopt;
    return number;
}

std::string checkHeader(const std::vector<std::string>& columns) {
    std::set<std::string> seen;
    for (const auto& column : columns) {
        if (column.empty()) return "line 1: a column has no name";
        if (!seen.insert(column).second)
            return "line 1: two columns have the name '" + column + "'";
        if (!pxr::SdfPath::IsValidIdentifier(column))
            return "line 1: the column '" + column + "' is no identifier";
    }
    if (!seen.contains("asset")) return "line 1: there is no column 'asset'";
    return {};
}

// Sets one cell; returns what is wrong with it.
std::string set(Placement& row, const std::string& column, const std::string& cell) {
    if (const auto texts = textsOf(row); texts.contains(column)) {
        *texts.at(column) = cell;
        return {};
    }
    const auto numbers = numbersOf(row);
    if (column != "scale" && !numbers.contains(column)) {
        row.other.emplace_back("table:" + column, cell);
        return {};
    }
    if (cell.empty()) return {};
    const auto number = finite(cell);
    if (!number) return column + " is '" + cell.substr(0, 100) + "', which is no number";
    if (column == "scale")
        row.scale = {*number, *number, *number};
    else
        *numbers.at(column) = *number;
    return {};
}

// Returns what is wrong with a text that is not UTF-8. The bytes of UTF-16 and UTF-32 have NULs.
std::string checkEncoding(std::string_view text) {
    const auto lineOf = [&](std::size_t at) {
        return "line " + std::to_string(1 + std::ranges::count(text.substr(0, at), '\n')) + ": ";
    };
    constexpr const char* kAdvice = "; save the table as UTF-8";
    if (const auto nul = text.find('\0'); nul != std::string_view::npos)
        return lineOf(nul) + "the text is not UTF-8, perhaps UTF-16" + kAdvice;
    const pxr::TfUtf8CodePointView points(text);
    for (auto point = points.begin(); point != points.end(); ++point)
        if (*point == pxr::TfUtf8InvalidCodePoint &&
            !text.substr(std::size_t(point.GetBase() - text.begin())).starts_with("\xEF\xBF\xBD"))
            return lineOf(std::size_t(point.GetBase() - text.begin())) +
                   "the text is not UTF-8, perhaps Latin-1" + kAdvice;
    return {};
}

// Gives each row a name of its own, derived from its cell.
std::string uniqueName(const Placement& row, std::size_t index, std::set<std::string>& used) {
    const std::string base = row.name.empty() ? "Row_" + std::to_string(index + 1)
                                              : pxr::TfMakeValidIdentifier(row.name);
    std::string name = base;
    for (std::size_t number = index + 1; !used.insert(name).second; ++number)
        name = base + "_" + std::to_string(number);
    return name;
}

std::string check(const Placement& row) {
    // Asset paths are written between @ signs, and cannot have control characters.
    for (const unsigned char c : row.asset)
        if (c < 0x20 || c == 0x7f) return "asset has a control character";
    if (row.prim.empty()) return {};
    const bool isPath = pxr::SdfPath::IsValidPathString(row.prim);
    if (!isPath || !pxr::SdfPath(row.prim).IsAbsoluteRootOrPrimPath() ||
        !pxr::SdfPath(row.prim).IsAbsolutePath())
        return "prim is '" + row.prim.substr(0, 100) + "', which is no absolute path of a prim";
    return {};
}

}  // namespace

Placements readPlacements(std::string_view text) {
    Placements made;
    made.error = checkEncoding(text);
    if (!made.error.empty()) return made;
    const Csv csv = readCsv(text);
    made.error = csv.error;
    if (made.error.empty() && csv.rows.empty()) made.error = "line 1: there is no row of columns";
    if (made.error.empty()) made.error = checkHeader(csv.rows.front().cells);
    if (!made.error.empty()) return made;

    const auto& columns = csv.rows.front().cells;
    std::set<std::string> used;
    for (std::size_t index = 1; index < csv.rows.size(); ++index) {
        const std::size_t line = csv.rows[index].line;
        const auto& cells = csv.rows[index].cells;
        const auto failed = [&](const std::string& what) {
            made.rows.clear();
            made.error = "line " + std::to_string(line) + ": " + what;
        };
        if (cells.size() > columns.size()) {
            failed("there are " + std::to_string(cells.size()) + " cells in " +
                   std::to_string(columns.size()) + " columns");
            return made;
        }
        Placement row;
        std::string wrong;
        for (std::size_t i = 0; i < cells.size() && wrong.empty(); ++i)
            wrong = set(row, columns[i], cells[i]);
        if (wrong.empty()) wrong = check(row);
        if (!wrong.empty()) {
            failed(wrong);
            return made;
        }
        row.name = uniqueName(row, index - 1, used);
        made.rows.push_back(std::move(row));
    }
    return made;
}

}  // namespace usdlive::edf::table
