// Comma-separated values as RFC 4180 describes them.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace usdlive::edf::table {

struct CsvRow {
    std::size_t line = 0;  ///< the first line of the row, from 1
    std::vector<std::string> cells;
};

struct CsvLimits {
    std::size_t rows = 100'000, columns = 256, cellBytes = 64 * 1024;
    std::size_t cells = 2'000'000;  ///< counts those of all rows
};

struct Csv {
    std::vector<CsvRow> rows;
    std::string error;  ///< names the line; empty if all could be read
};

/// Splits a text in rows and cells. Rows end with a line feed, with or without a carriage return;
/// empty lines and a byte order mark are skipped. Cells in double quotes may contain commas, line
/// ends, and quotes written twice. Stops at the first error: a quote inside of a plain cell, text
/// after a closing quote, an open quote at the end, a limit.
[[nodiscard]] Csv readCsv(std::string_view text, const CsvLimits& limits = {});

}  // namespace usdlive::edf::table
