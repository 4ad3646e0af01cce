// Removes folders of the machine from texts.
#include "project/PublicText.h"

#include <algorithm>
#include <utility>

namespace usdlive::server {

namespace {

/// Returns whether a path can go on with this character, so that "/project" does not begin there.
bool isOfName(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-' || c == '/' || (c & 0x80) != 0;
}

}  // namespace

PublicText::PublicText(std::vector<std::string> folders) : folders_(std::move(folders)) {
    for (std::string& folder : folders_)
        while (folder.ends_with('/')) folder.pop_back();
    std::erase(folders_, "");
    std::ranges::sort(folders_, std::ranges::greater(), &std::string::size);
}

std::string PublicText::operator()(std::string text) const {
    for (const std::string& folder : folders_) {
        std::size_t at = 0;
        while ((at = text.find(folder, at)) != std::string::npos) {
            const std::size_t end = at + folder.size();
            const bool isBelow = end + 1 < text.size() && text[end] == '/' && text[end + 1] != ' ';
            if (isBelow)
                text.erase(at, folder.size() + 1);
            else if (end < text.size() && isOfName(text[end]) && text[end] != '/')
                at = end;  // another folder, whose name begins as this one's
            else
                text.replace(at++, folder.size(), 1, '.');
        }
    }
    return text;
}

Error PublicText::operator()(Error error) const {
    error.message = (*this)(std::move(error.message));
    return error;
}

}  // namespace usdlive::server
