// The interface of the server's log.
#pragma once

#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <string_view>
#include <variant>

namespace usdlive::server {

enum class LogLevel { Debug, Info, Warning, Error };

/// A name and a value that describe an event. Valid during the call only.
struct LogField {
    std::string_view name;
    std::variant<std::string_view, std::int64_t> value;

    LogField(std::string_view name, std::string_view text) : name(name), value(text) {}
    template <std::integral T>
    LogField(std::string_view name, T number) : name(name), value(std::int64_t(number)) {}
};

/// Receives the events of the server. An event is a short text that never varies, with fields.
/// Called from any thread.
class Log {
public:
    virtual ~Log() = default;
    virtual void write(LogLevel level, std::string_view event,
                       std::initializer_list<LogField> fields = {}) = 0;
};

}  // namespace usdlive::server
