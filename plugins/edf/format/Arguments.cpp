// Translates the metadata of a prim to the arguments of a layer and back.
#include "Arguments.h"

#include <pxr/base/tf/stringUtils.h>
#include <pxr/base/tf/token.h>

#include <set>
#include <string_view>

namespace usdlive::edf {

namespace {

constexpr std::string_view kId = "dataProviderId", kArgs = "providerArgs", kInvalid = "edfInvalid";
// Longer identifiers of layers help nobody.
constexpr std::size_t kMaxTextBytes = 8 * 1024, kMaxArguments = 256;

bool isSeparator(unsigned char c) {
    return c < 0x20 || c == 0x7f ||
           std::string_view("%&=[]").find(char(c)) != std::string_view::npos;
}

std::string encoded(std::string_view text) {
    std::string out;
    for (const char c : text) {
        if (isSeparator(static_cast<unsigned char>(c)))
            out += pxr::TfStringPrintf("%%%02X", static_cast<unsigned char>(c));
        else
            out += c;
    }
    return out;
}

int digitOf(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return -1;
}

std::string decoded(std::string_view text) {
    std::string out;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const int high = text[i] == '%' && i + 2 < text.size() ? digitOf(text[i + 1]) : -1;
        const int low = high < 0 ? -1 : digitOf(text[i + 2]);
        if (low < 0) {
            out += text[i];
        } else {
            out += char(high * 16 + low);
            i += 2;
        }
    }
    return out;
}

// Returns false for values that are not one text, number or boolean.
bool textOf(const pxr::VtValue& value, std::string& text) {
    if (value.IsHolding<std::string>()) {
        text = value.UncheckedGet<std::string>();
    } else if (value.IsHolding<pxr::TfToken>()) {
        text = value.UncheckedGet<pxr::TfToken>().GetString();
    } else if (value.IsHolding<bool>()) {
        text = value.UncheckedGet<bool>() ? "true" : "false";
    } else if (value.CanCast<double>() && !value.IsArrayValued()) {
        text = pxr::TfStringify(value);
    } else {
        return false;
    }
    return text.size() <= kMaxTextBytes;
}

std::string complaint(const std::string& what, const pxr::VtValue& value, const char* wanted) {
    return "EdfDataParameters: " + what + " is of type " + value.GetTypeName() + " or too long; " +
           wanted;
}

const pxr::VtDictionary* dictionaryAt(const pxr::VtDictionary& dictionary, std::string_view key) {
    const auto found = dictionary.find(std::string(key));
    if (found == dictionary.end() || !found->second.IsHolding<pxr::VtDictionary>()) return nullptr;
    return &found->second.UncheckedGet<pxr::VtDictionary>();
}

pxr::VtValue valueAt(const pxr::VtDictionary& dictionary, const std::string& key) {
    const auto found = dictionary.find(key);
    return found == dictionary.end() ? pxr::VtValue() : found->second;
}

// One opinion matters for the composed value if it is new or was the strongest, and says something
// else now.
bool matters(const pxr::VtValue& before, const pxr::VtValue& after, const pxr::VtValue& composed) {
    return before != after && after != composed && (before.IsEmpty() || before == composed);
}

bool anyMatters(const pxr::VtDictionary& before, const pxr::VtDictionary& after,
                const pxr::VtDictionary& composed) {
    std::set<std::string> keys;
    for (const auto& [key, value] : before) keys.insert(key);
    for (const auto& [key, value] : after) keys.insert(key);
    for (const auto& key : keys)
        if (matters(valueAt(before, key), valueAt(after, key), valueAt(composed, key))) return true;
    return false;
}

bool isDictionaryOrAbsent(const pxr::VtValue& value) {
    return value.IsEmpty() || value.IsHolding<pxr::VtDictionary>();
}

}  // namespace

Request requestOf(const pxr::VtDictionary& metadata) {
    Request request;
    const auto id = valueAt(metadata, std::string(kId));
    if (!id.IsEmpty() && !textOf(id, request.dataProviderId))
        request.invalid = complaint(std::string(kId), id, "it must be a string");
    const auto args = valueAt(metadata, std::string(kArgs));
    if (args.IsEmpty() || !request.invalid.empty()) return request;
    if (!args.IsHolding<pxr::VtDictionary>()) {
        request.invalid = complaint(std::string(kArgs), args, "it must be a dictionary of strings");
        return request;
    }
    const auto& dictionary = args.UncheckedGet<pxr::VtDictionary>();
    if (dictionary.size() > kMaxArguments)
        request.invalid = "EdfDataParameters: more than 256 providerArgs";
    for (const auto& [key, value] : dictionary) {
        if (!request.invalid.empty()) break;
        if (!textOf(value, request.providerArgs[key]))
            request.invalid = complaint("providerArgs:" + key, value,
                                        "it must be a string, a number or a boolean");
    }
    return request;
}

void addTo(LayerArguments& arguments, const Request& request) {
    if (!request.invalid.empty()) arguments[std::string(kInvalid)] = encoded(request.invalid);
    arguments[std::string(kId)] = encoded(request.dataProviderId);
    for (const auto& [key, value] : request.providerArgs)
        arguments[std::string(kArgs) + ":" + encoded(key)] = encoded(value);
}

Request requestOf(const LayerArguments& arguments) {
    const std::string prefix = std::string(kArgs) + ":";
    Request request;
    for (const auto& [key, value] : arguments) {
        if (key == kId) request.dataProviderId = decoded(value);
        if (key == kInvalid) request.invalid = decoded(value);
        if (key.starts_with(prefix))
            request.providerArgs[decoded(key.substr(prefix.size()))] = decoded(value);
    }
    return request;
}

bool canChangeRequest(const pxr::VtValue& before, const pxr::VtValue& after,
                      const pxr::VtDictionary& composed) {
    if (!isDictionaryOrAbsent(before) || !isDictionaryOrAbsent(after)) return true;
    const pxr::VtDictionary none;
    const auto& old = before.IsEmpty() ? none : before.UncheckedGet<pxr::VtDictionary>();
    const auto& now = after.IsEmpty() ? none : after.UncheckedGet<pxr::VtDictionary>();
    const std::string id(kId), args(kArgs);
    if (matters(valueAt(old, id), valueAt(now, id), valueAt(composed, id))) return true;
    for (const auto* one : {&old, &now, &composed})
        if (one->count(args) && !dictionaryAt(*one, args)) return true;
    const auto argsOf = [&](const pxr::VtDictionary& dictionary) -> const pxr::VtDictionary& {
        const auto* found = dictionaryAt(dictionary, args);
        return found ? *found : none;
    };
    return anyMatters(argsOf(old), argsOf(now), argsOf(composed));
}

}  // namespace usdlive::edf
