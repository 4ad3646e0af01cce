// Notes with each answer how to revalidate it.
#include "AnswerCache.h"

#include <charconv>
#include <string_view>

namespace usdlive::edf::museum {

namespace {

// Takes a line off the text.
std::string_view takeLine(std::string_view& text) {
    const std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), line.size() + 1));
    return line;
}

}  // namespace

std::optional<CachedAnswer> AnswerCache::find(const std::string& url) {
    auto noted = files_.noted(url);
    if (!noted) return std::nullopt;
    CachedAnswer answer;
    std::string_view note = noted->note;
    const std::string_view fresh = takeLine(note);
    const auto read = std::from_chars(fresh.data(), fresh.data() + fresh.size(), answer.freshUntil);
    if (read.ec != std::errc()) return std::nullopt;
    answer.etag = takeLine(note);
    answer.lastModified = takeLine(note);
    answer.body = std::move(noted->content);
    return answer;
}

void AnswerCache::store(const std::string& url, const CachedAnswer& answer) {
    files_.note(url, {answer.body, std::to_string(answer.freshUntil) + "\n" + answer.etag + "\n" +
                                       answer.lastModified});
}

}  // namespace usdlive::edf::museum
