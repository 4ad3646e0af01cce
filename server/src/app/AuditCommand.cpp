// Prints and checks the audit log.
#include "app/AuditCommand.h"

#include <CLI/CLI.hpp>
#include <charconv>
#include <deque>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "app/AdminCommands.h"
#include "auth/AuditFile.h"

namespace usdlive::server {

namespace {

using Json = nlohmann::json;

struct Wanted {
    std::filesystem::path folder;
    std::string user, event, project, expected;
    std::size_t last = 0;  ///< 0: all
    bool json = false;
};

/// A record that somebody has noted, as NUMBER:HASH.
struct Noted {
    std::uint64_t number = 0;
    std::string hash;
};

std::optional<Noted> parseNoted(std::string_view text) {
    Noted noted;
    const char* const end = text.data() + text.size();
    const auto [read, error] = std::from_chars(text.data(), end, noted.number);
    if (error != std::errc{} || read == end || *read != ':') return std::nullopt;
    noted.hash = std::string(read + 1, end);
    return hashFromHex(noted.hash) ? std::optional(noted) : std::nullopt;
}

std::string textIn(const Json& record, const char* name) {
    const auto found = record.is_object() ? record.find(name) : record.end();
    return found != record.end() && found->is_string() ? found->get<std::string>() : "";
}

bool isWanted(const Json& record, const Wanted& wanted) {
    const auto fits = [&](const char* name, const std::string& text) {
        return text.empty() || textIn(record, name) == text;
    };
    return fits("user", wanted.user) && fits("event", wanted.event) &&
           fits("project", wanted.project);
}

/// Returns a text in which control characters cannot change a terminal.
std::string printable(std::string text) {
    for (char& c : text)
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
    return text;
}

std::string sentenceOf(std::uint64_t number, const Json& record) {
    std::string text =
        std::to_string(number) + "  " + textIn(record, "time") + "  " + textIn(record, "event");
    for (const char* name : {"user", "from", "project", "layer", "detail"})
        if (const std::string value = textIn(record, name); !value.empty())
            text += "  " + std::string(name) + "=" + value;
    return printable(text);
}

Result<void> printAudit(const Wanted& wanted) {
    std::optional<Noted> noted;
    if (!wanted.expected.empty()) {
        noted = parseNoted(wanted.expected);
        if (!noted)
            return fail(ErrorCode::InvalidArgument,
                        wanted.expected +
                            " is not a record; expected NUMBER:HASH, as this command "
                            "prints it at the end");
    }
    const AuditFile file(accountsFolderOf(wanted.folder));
    std::deque<std::string> kept;
    bool isNotedFound = false;
    const auto found =
        file.read([&](std::uint64_t number, const Hash& hash, std::string_view line) {
            if (noted && noted->number == number && noted->hash == hash.hex()) isNotedFound = true;
            const Json record = Json::parse(line, nullptr, false);
            if (!isWanted(record, wanted)) return;
            std::string text = wanted.json ? std::string(line) : sentenceOf(number, record);
            if (wanted.last == 0) {
                std::cout << text << "\n";
                return;
            }
            kept.push_back(std::move(text));
            if (kept.size() > wanted.last) kept.pop_front();
        });
    if (!found) return tl::unexpected(found.error());
    for (const std::string& text : kept) std::cout << text << "\n";
    if (found->records == 0) {
        std::cerr << "There are no records in " << file.path().string()
                  << ". A server whose users sign in writes them.\n";
    } else {
        std::cerr << found->records << (found->records == 1 ? " record" : " records")
                  << ", the last one is " << found->last << ":" << found->head.hex() << "\n";
    }
    if (found->damage)
        return fail(ErrorCode::StorageCorrupt, "the audit log was changed: " + *found->damage);
    if (noted && !isNotedFound)
        return fail(ErrorCode::StorageCorrupt,
                    "the audit log was changed: it does not have the record " + wanted.expected);
    return {};
}

}  // namespace

int runAuditCommand(int argc, const char* const* argv) {
    Wanted wanted;
    CLI::App app("Prints the audit log of a server, and checks that nobody has changed it.",
                 kAuditCommand);
    app.footer(R"(
The command prints the number and the hash of the last record. Who notes them somewhere else can ask later with
--expect whether the records until then are still the same.)");
    app.add_option("DIR", wanted.folder, "The served folder")
        ->required()
        ->check(CLI::ExistingDirectory.description(""))
        ->type_name("");
    app.add_option("--user", wanted.user, "Only actions of this user")->type_name("NAME");
    app.add_option("--event", wanted.event, "Only this event, for example 'edits refused'")
        ->type_name("TEXT");
    app.add_option("--project", wanted.project, "Only actions in this project")->type_name("NAME");
    app.add_option("--last", wanted.last, "Only the last N of them")
        ->check(CLI::PositiveNumber.description(""))
        ->type_name("N");
    app.add_option("--expect", wanted.expected, "A record that must be there")
        ->type_name("NUMBER:HASH");
    app.add_flag("--json", wanted.json, "Print the records as they are, one JSON object per line");
    return runAdminCommand(app, argc, argv, [&] { return printAudit(wanted); });
}

}  // namespace usdlive::server
