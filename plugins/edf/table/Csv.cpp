// Reads comma-separated values.
#include "Csv.h"

#include <utility>

namespace usdlive::edf::table {

namespace {

class CsvReader {
public:
    CsvReader(std::string_view text, const CsvLimits& limits) : text_(text), limits_(limits) {
        if (text_.starts_with("\xEF\xBB\xBF")) text_.remove_prefix(3);
    }

    Csv all() {
        while (at_ < text_.size() && csv_.error.empty()) readRow();
        return std::move(csv_);
    }

private:
    void readRow() {
        CsvRow row{line_, {}};
        do row.cells.push_back(readCell());
        while (csv_.error.empty() && takeComma(row));
        if (!csv_.error.empty()) return;
        cells_ += row.cells.size();
        if (cells_ > limits_.cells)
            return fail("there are more than " + std::to_string(limits_.cells) + " cells");
        takeLineEnd();
        if (row.cells.size() == 1 && row.cells.front().empty() && !wasQuoted_) return;
        if (csv_.rows.size() == limits_.rows)
            return fail("there are more than " + std::to_string(limits_.rows) + " rows");
        csv_.rows.push_back(std::move(row));
    }

    bool takeComma(const CsvRow& row) {
        if (at_ == text_.size() || text_[at_] != ',') return false;
        ++at_;
        if (row.cells.size() == limits_.columns)
            fail("there are more than " + std::to_string(limits_.columns) + " columns");
        return csv_.error.empty();
    }

    void takeLineEnd() {
        if (at_ == text_.size()) return;
        if (text_[at_] == '\r') ++at_;
        if (at_ < text_.size() && text_[at_] == '\n') ++at_;
        ++line_;
    }

    [[nodiscard]] bool isLineEnd() const {
        return text_[at_] == '\n' ||
               (text_[at_] == '\r' && (at_ + 1 == text_.size() || text_[at_ + 1] == '\n'));
    }

    std::string readCell() {
        wasQuoted_ = at_ < text_.size() && text_[at_] == '"';
        std::string cell = wasQuoted_ ? readQuoted() : readPlain();
        if (cell.size() > limits_.cellBytes)
            fail("a cell is longer than " + std::to_string(limits_.cellBytes) + " bytes");
        return cell;
    }

    std::string readPlain() {
        const std::size_t begin = at_;
        for (; at_ < text_.size() && text_[at_] != ',' && !isLineEnd(); ++at_)
            if (text_[at_] == '"') fail("a quote in a cell that does not begin with one");
        return std::string(text_.substr(begin, at_ - begin));
    }

    std::string readQuoted() {
        std::string cell;
        for (++at_; at_ < text_.size(); ++at_) {
            if (text_[at_] == '"') {
                ++at_;
                if (at_ == text_.size() || text_[at_] == ',' || isLineEnd()) return cell;
                if (text_[at_] != '"') {
                    fail("text after the closing quote of a cell");
                    return cell;
                }
            }
            if (text_[at_] == '\n') ++line_;
            cell += text_[at_];
        }
        fail("a quote is not closed");
        return cell;
    }

    void fail(const std::string& what) {
        if (csv_.error.empty()) csv_.error = "line " + std::to_string(line_) + ": " + what;
    }

    std::string_view text_;
    const CsvLimits& limits_;
    std::size_t at_ = 0, line_ = 1, cells_ = 0;
    bool wasQuoted_ = false;
    Csv csv_;
};

}  // namespace

Csv readCsv(std::string_view text, const CsvLimits& limits) {
    return CsvReader(text, limits).all();
}

}  // namespace usdlive::edf::table
