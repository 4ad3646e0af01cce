// Fuzzes what the data providers of plugins/edf read from outside: JSON of a museum's service,
// tables, addresses. The first byte chooses which.
#include <pxr/usd/sdf/path.h>

#include <cmath>
#include <set>

#include "Fuzz.h"
#include "plugins/edf/museum/Address.h"
#include "plugins/edf/museum/Collection.h"
#include "plugins/edf/table/Csv.h"
#include "plugins/edf/table/Placements.h"

using namespace usdlive;
using fuzz::require;
namespace museum = edf::museum;
namespace table = edf::table;

namespace {

bool isNumber(const std::string& text) {
    return !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
}

bool isPrintable(const std::string& text) {
    for (const unsigned char c : text)
        if ((c < 0x20 && c != '\n' && c != '\t') || c == 0x7f) return false;
    return true;
}

void checkCollection(std::string_view text) {
    if (const auto departments = museum::readDepartments(text)) {
        std::set<std::string> ids;
        for (const auto& one : *departments) {
            require(isNumber(one.id) && ids.insert(one.id).second,
                    "ids of departments are numbers, each once");
            require(isPrintable(one.displayName), "names are printable");
        }
    }
    if (const auto ids = museum::readObjectIds(text)) {
        std::set<std::string> seen;
        for (const auto& id : *ids)
            require(isNumber(id) && seen.insert(id).second,
                    "ids of objects are numbers, each once");
    }
    if (const auto object = museum::readObject(text)) {
        require(isNumber(object->id), "the id of an object is a number");
        for (const auto& [name, value] : object->texts)
            require(!value.empty() && isPrintable(value), "texts are printable and not empty");
    }
}

std::string quoted(const std::string& cell) {
    std::string out = "\"";
    for (const char c : cell) out += c == '"' ? std::string("\"\"") : std::string(1, c);
    return out + "\"";
}

void checkTable(std::string_view text) {
    const auto csv = table::readCsv(text, {.rows = 50, .columns = 20, .cellBytes = 200});
    if (csv.error.empty()) {
        std::string again;
        for (const auto& row : csv.rows)
            for (std::size_t i = 0; i < row.cells.size(); ++i)
                again += quoted(row.cells[i]) + (i + 1 < row.cells.size() ? "," : "\n");
        const auto second = table::readCsv(again);
        require(second.error.empty() && second.rows.size() == csv.rows.size(),
                "a written table is read again");
        for (std::size_t i = 0; i < csv.rows.size(); ++i)
            require(second.rows[i].cells == csv.rows[i].cells, "cells survive writing and reading");
    }
    const auto placements = table::readPlacements(text);
    require(placements.error.empty() || placements.rows.empty(), "an error has no rows");
    std::set<std::string> names;
    for (const auto& row : placements.rows) {
        require(pxr::SdfPath::IsValidIdentifier(row.name) && names.insert(row.name).second,
                "names are identifiers, each once");
        for (const auto* numbers : {&row.translate, &row.rotate, &row.scale})
            for (const double number : *numbers)
                require(std::isfinite(number), "numbers are finite");
        require(row.prim.empty() || pxr::SdfPath(row.prim).IsAbsolutePath(),
                "prims have absolute paths");
    }
}

void checkAddress(std::string_view text) {
    const auto address = museum::readAddress(text);
    if (!address) return;
    const auto again = museum::readAddress(address->text());
    require(again && again->text() == address->text(), "an address is read from its own text");
    require(address->path.find_first_of(" ?#@\r\n") == std::string::npos,
            "a path has no separators");
    require(museum::isAllowed(*address, "x," + address->origin.hostInUrl()),
            "a host in the list is allowed");
    require(!museum::isAllowed(*address, ""), "nothing is allowed without a list");
    require(!museum::chooseAddress(std::string(text), "", "other.example"),
            "a scene cannot choose any host");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size == 0) return 0;
    const std::string_view text = asText({data + 1, size - 1});
    if (data[0] == 'c') checkCollection(text);
    if (data[0] == 't') checkTable(text);
    if (data[0] == 'a') checkAddress(text);
    return 0;
}

std::vector<Bytes> fuzz::seeds() {
    std::vector<Bytes> all;
    for (
        const std::string_view text : {
            R"(c{"departments": [{"departmentId": 1, "displayName": "Art"}, {"departmentId": "2"}]})",
            R"(c{"total": 2, "objectIDs": [1, 2, 18446744073709551615]})",
            R"(c{"total": 0, "objectIDs": null})",
            R"(c{"objectID": 7, "objectName": "Cup", "title": "x\u0007\ud83d\ude00", "isHighlight": true, "artistRole": "Maker"})",
            "tname,asset,prim,x,y,z,rotateX,scale,note\na,./b.usda,/P,1,2e3,-.5,90,2,\"x, "
            "\"\"y\"\"\nz\"\r\n,,,,,,,,\n",
            "t\xEF\xBB\xBF"
            "asset,scaleX,scaleY,scaleZ\nx,1,2,3\n",
            "ahttp://localhost:8080/public/collection/v1/",
            "ahttp://[::1]:80/a",
            "ahttps://example.org",
            "ahttp://a_b.example",
        })
        all.push_back(copyOf(asBytes(text)));
    return all;
}
