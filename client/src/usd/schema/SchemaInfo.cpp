// Parses the names of schemas: versions, instance names and templates.
#include "usdlive/client/usd/schema/SchemaInfo.h"

#include <algorithm>
#include <charconv>
#include <string_view>

namespace usdlive::schema {

using pxr::TfToken;

namespace {

constexpr std::string_view kPlaceholder = "__INSTANCE_NAME__";

// Returns the position of the placeholder as a whole part of a name with colons, or npos.
std::size_t placeholderIn(const std::string& name) {
    for (auto at = name.find(kPlaceholder); at != std::string::npos;
         at = name.find(kPlaceholder, at + 1)) {
        const auto end = at + kPlaceholder.size();
        const bool begins = at == 0 || name[at - 1] == ':';
        if (begins && (end == name.size() || name[end] == ':')) return at;
    }
    return std::string::npos;
}

}  // namespace

std::pair<TfToken, unsigned> familyAndVersion(const TfToken& identifier) {
    const std::string& text = identifier.GetString();
    const auto digits = text.find_last_not_of("0123456789");
    const bool versioned =
        digits != std::string::npos && digits + 1 < text.size() && text[digits] == '_';
    unsigned version = 0;
    if (!versioned) return {identifier, version};
    const auto [end, problem] =
        std::from_chars(text.data() + digits + 1, text.data() + text.size(), version);
    if (problem != std::errc()) return {identifier, 0};
    return {TfToken(text.substr(0, digits)), version};
}

AppliedName parseAppliedName(const TfToken& name) {
    const std::string& text = name.GetString();
    const auto colon = text.find(':');
    if (colon == std::string::npos) return {name, TfToken()};
    return {TfToken(text.substr(0, colon)), TfToken(text.substr(colon + 1))};
}

bool isNameTemplate(const TfToken& name) {
    return placeholderIn(name.GetString()) != std::string::npos;
}

TfToken withInstanceName(const TfToken& nameTemplate, const TfToken& instance) {
    std::string name = nameTemplate.GetString();
    const auto at = placeholderIn(name);
    if (at == std::string::npos) return nameTemplate;
    return TfToken(name.replace(at, kPlaceholder.size(), instance.GetString()));
}

std::string templateBaseName(const TfToken& nameTemplate) {
    const std::string& name = nameTemplate.GetString();
    const auto at = placeholderIn(name);
    if (at == std::string::npos) return name;
    return name.substr(std::min(at + kPlaceholder.size() + 1, name.size()));
}

}  // namespace usdlive::schema
