// Tests the declaration of control messages (Control.h, Requests.h): each goes through JSON and
// back, and the tables of PROTOCOL.md list exactly its members.
#include "usdlive/common/protocol/Requests.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "usdlive/common/protocol/Control.h"

namespace usdlive {
namespace {

/// Calls `visit(message)` with one of each type of ControlMessage.
template <class Visit>
void forEachMessage(Visit visit) {
    [&]<std::size_t... indices>(std::index_sequence<indices...>) {
        (visit(std::variant_alternative_t<indices, ControlMessage>()), ...);
    }(std::make_index_sequence<std::variant_size_v<ControlMessage>>());
}

// ---- a value for each field, all different

struct Filler {
    std::uint64_t next = 0;

    template <class T>
        requires std::is_arithmetic_v<T>
    void fill(T& value) {
        value = T(++next);
    }
    void fill(bool& value) { value = true; }
    void fill(std::string& text) { text = "text" + std::to_string(++next); }
    template <class Tag>
    void fill(Id<Tag>& id) {
        id.value = "id" + std::to_string(++next);
    }
    void fill(LayerId& layer) { layer.value = "layer" + std::to_string(++next) + ".usda"; }
    void fill(Hash& hash) { hash = sha256(asBytes(std::to_string(++next))); }
    template <class T>
    void fill(std::optional<T>& value) {
        fill(value.emplace(T{}));
    }
    template <class T>
    void fill(std::vector<T>& values) {
        fill(values.emplace_back());
        fill(values.emplace_back());
    }
    template <HasFields T>
    void fill(T& message) {
        forEachField(message, [this](std::string_view, auto& field) { this->fill(field); });
    }
};

TEST(Requests, EveryMessageKeepsEveryField) {
    forEachMessage([](auto message) {
        SCOPED_TRACE(message.kType);
        Filler().fill(message);
        const auto decoded = decodeControl(encodeControl(message));
        ASSERT_TRUE(decoded) << decoded.error().message;
        EXPECT_EQ(*decoded, ControlMessage(message));
        const auto empty = decltype(message)();
        if constexpr (requires { message.layer; }) {
            EXPECT_FALSE(decodeControl(encodeControl(empty))) << "a layer has no name";
        }
    });
}

TEST(Requests, EveryTypeHasANameOfItsOwn) {
    std::set<std::string_view> types;
    forEachMessage([&](const auto& message) {
        EXPECT_TRUE(types.insert(message.kType).second) << message.kType;
        EXPECT_NE(encodeControl(message).find("\"type\":\"" + std::string(message.kType) + "\""),
                  std::string::npos);
    });
}

TEST(Requests, AServerNamesTheFeaturesOfItsRequests) {
    const auto& all = protocolFeatures();
    EXPECT_EQ(std::set(all.begin(), all.end()).size(), all.size()) << "each once";
    forEachRequest([&]<class Request>(const Request& request) {
        const std::string feature(featureOf<Request>());
        EXPECT_TRUE(feature.empty() || std::ranges::count(all, feature) == 1) << request.kType;
    });
}

// ---- PROTOCOL.md

template <class T>
std::string membersOf();

template <class T>
std::string mark(const T*) {
    if constexpr (HasFields<T>)
        return " {" + membersOf<T>() + "}";
    else
        return {};
}
template <class T>
std::string mark(const std::vector<T>*) {
    return "[]" + mark(static_cast<const T*>(nullptr));
}
template <class T>
std::string mark(const std::optional<T>*) {
    return "?" + mark(static_cast<const T*>(nullptr));
}

/// "layers[], force?": the members of a message as the tables of PROTOCOL.md write them.
template <class T>
std::string membersOf() {
    std::string all;
    T message;
    forEachField(message, [&](std::string_view name, auto& field) {
        all += (all.empty() ? "" : ", ") + std::string(name) + mark(&field);
    });
    return all;
}
/// Without the number of the request.
template <class T>
std::string withoutNumber() {
    const std::string all = membersOf<T>();
    EXPECT_TRUE(all.starts_with("request")) << T::kType;
    return all.substr(std::min(all.size(), std::string("request, ").size()));
}

using Row = std::vector<std::string>;

/// The rows of the table whose heading begins with `heading`, by their first cell.
std::map<std::string, Row> tableOf(const std::string& heading) {
    std::ifstream file(USDLIVE_PROTOCOL);
    std::map<std::string, Row> rows;
    bool isInside = false;
    for (std::string text; std::getline(file, text);) {
        if (text.starts_with(heading)) isInside = true;
        if (!isInside) continue;
        if (!text.starts_with("|")) break;
        Row row;
        std::istringstream cells(text.substr(1));
        for (std::string cell; std::getline(cells, cell, '|');) {
            const std::size_t first = cell.find_first_not_of(' ');
            const std::size_t last = cell.find_last_not_of(' ');
            row.push_back(first == cell.npos ? "" : cell.substr(first, last - first + 1));
        }
        EXPECT_TRUE(rows.emplace(row.front(), row).second) << row.front() << " is there twice";
    }
    return rows;
}

TEST(Requests, ProtocolMdListsTheMembersOfEveryMessage) {
    auto messages = tableOf("| type | from |");
    auto requests = tableOf("| request | members |");
    std::map<std::string, Row> answers;
    for (const auto& [request, row] : requests) answers[row.at(3)] = row;
    std::size_t count = 0;
    forEachMessage([&]<class Message>(const Message&) {
        const std::string type(Message::kType);
        SCOPED_TRACE(type);
        ++count;
        if constexpr (IsRequest<Message>) {
            ASSERT_TRUE(requests.contains(type)) << "PROTOCOL.md has no row for this request";
            const Row& row = requests.at(type);
            EXPECT_EQ(row.at(1), withoutNumber<Message>());
            EXPECT_EQ(row.at(2), featureOf<Message>());
            EXPECT_EQ(row.at(3), Message::Answer::kType);
            EXPECT_EQ(row.at(4), withoutNumber<typename Message::Answer>());
        } else if (!answers.contains(type)) {
            ASSERT_TRUE(messages.contains(type)) << "PROTOCOL.md has no row for this message";
            EXPECT_EQ(messages.at(type).at(2), membersOf<Message>());
        }
    });
    // Two lines of each table are its heading.
    EXPECT_EQ(messages.size() - 2 + 2 * (requests.size() - 2), count) << "PROTOCOL.md has others";
}

}  // namespace
}  // namespace usdlive
