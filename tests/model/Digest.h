// Writes the state of an object as text, to compare states.
#pragma once

#include <algorithm>
#include <concepts>
#include <map>
#include <optional>
#include <ranges>
#include <string>
#include <type_traits>
#include <unordered_map>
#include <utility>
#include <variant>
#include <vector>

#include "usdlive/common/layer/TransactionExecutor.h"
#include "usdlive/common/protocol/Control.h"
#include "usdlive/common/protocol/Frame.h"

namespace usdlive::model {

/// Writes down everything in a state that decides its future: two states with the same text behave
/// alike for ever. A type of ours declares its members in a function `digest` beside it. A function
/// that decomposes a struct no longer compiles when the struct gets another member.
class Digest {
public:
    template <class... Parts>
    void operator()(const Parts&... parts) {
        (put(parts), ...);
    }
    [[nodiscard]] const std::string& text() const { return text_; }

private:
    template <class T>
    void put(const T& part) {
        if constexpr (std::is_empty_v<T>) {
        } else if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T>) {
            text_.append(reinterpret_cast<const char*>(&part), sizeof part);
        } else if constexpr (std::same_as<T, std::string>) {
            put(part.size());
            text_ += part;
        } else if constexpr (std::same_as<T, Bytes>) {
            put(std::string(asText(part)));
        } else if constexpr (std::ranges::range<T>) {
            put(std::ranges::size(part));
            if constexpr (requires { typename T::hasher; })
                putSorted(part);
            else
                for (const auto& element : part) put(element);
        } else {
            digest(*this, part);
        }
    }
    template <class T>
    void put(const std::optional<T>& part) {
        put(part.has_value());
        if (part) put(*part);
    }
    template <class T, class U>
    void put(const std::pair<T, U>& part) {
        (*this)(part.first, part.second);
    }
    template <class... Ts>
    void put(const std::variant<Ts...>& part) {
        put(part.index());
        std::visit([&](const auto& one) { put(one); }, part);
    }
    template <class Tag>
    void put(const Id<Tag>& part) {
        put(part.value);
    }
    void put(const Hash& part) { put(part.bytes); }
    void put(const SharedBytes& part) { put(*part); }

    void putSorted(const auto& part) {
        std::vector<std::string> sorted;
        for (const auto& element : part) {
            Digest one;
            one.put(element);
            sorted.push_back(one.text_);
        }
        std::sort(sorted.begin(), sorted.end());
        for (const std::string& one : sorted) text_ += one;
    }

    std::string text_;
};

inline void digest(Digest& out, const Error& part) {
    const auto& [code, message] = part;
    out(code, message);
}
inline void digest(Digest& out, const Value& part) { out(encodeFieldValue(part)); }
inline void digest(Digest& out, const FieldValue& part) { out(encodeFieldValue(part)); }
inline void digest(Digest& out, const Creation& part) {
    const auto& [sequence, edit] = part;
    out(sequence, edit);
}
inline void digest(Digest& out, const Address& part) {
    const auto& [path, creation] = part;
    out(path, creation);
}
inline void digest(Digest& out, const DictionaryKey& part) { out(part.path); }
inline void digest(Digest& out, const SampleTime& part) { out(part.time); }
inline void digest(Digest& out, const ListItem& part) {
    const auto& [list, item, before] = part;
    out(list, item, before);
}
inline void digest(Digest& out, const MapKey& part) { out(part.key); }
inline void digest(Digest& out, const CreateSpec& part) { out(part.kind); }
inline void digest(Digest& out, const DeleteSpec& part) { out(part.place); }
inline void digest(Digest& out, const MoveSpec& part) {
    const auto& [parent, name, place] = part;
    out(parent, name, place);
}
inline void digest(Digest& out, const PlaceSpec& part) { out(part.before); }
inline void digest(Digest& out, const SetField& part) {
    const auto& [field, place, value, form] = part;
    out(field, place, value, form);
}
inline void digest(Digest& out, const EraseField& part) {
    const auto& [field, place] = part;
    out(field, place);
}
inline void digest(Digest& out, const Edit& part) {
    const auto& [layer, address, action, names] = part;
    out(layer, address, action, names);
}
inline void digest(Digest& out, const TransactionId& part) {
    const auto& [client, sequence] = part;
    out(client, sequence);
}
inline void digest(Digest& out, const Transaction& part) {
    const auto& [id, base, gesture, edits, seen, label] = part;
    out(id, base, gesture, edits, seen, label);
}
inline void digest(Digest& out, const LayerDoc& part) {
    out(part.nextId());
    part.visit([&](const LayerDoc::SpecView& spec) {
        out(spec.node, spec.parent, spec.order, spec.kind, std::string(spec.name), *spec.fields);
    });
}
inline void digest(Digest& out, const NamespaceLog::Entry& part) {
    const auto& [revision, layer, from, to, what, author] = part;
    out(revision, layer, from, to, what, author);
}
inline void digest(Digest& out, const NamespaceLog::Naming& part) {
    const auto& [revision, layer, path, field, mark, author] = part;
    out(revision, layer, path, field, mark, author);
}
inline void digest(Digest& out, const NamespaceLog& part) {
    out(part.entries_, part.first_, part.oldest_);  // byPath_ follows from entries_
    out(part.namings_, part.namingsSince_);
}
inline void digest(Digest& out, const PlaceBefore& part) {
    const auto& [path, mark] = part;
    out(path, mark);
}
inline void digest(Digest& out, const OwnCreations::Entry& part) {
    const auto& [layer, path, mark, place] = part;
    out(layer, path, mark, place);
}
inline void digest(Digest& out, const OwnCreations::Kept& part) {
    const auto& [entry, revision] = part;
    out(entry, revision);
}
inline void digest(Digest& out, const OwnCreations& part) { out(part.entries_); }
inline void digest(Digest& out, const ControlMessage& part) { out(encodeControl(part)); }

}  // namespace usdlive::model
