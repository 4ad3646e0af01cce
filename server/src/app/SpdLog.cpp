// Writes the log as text or JSON with spdlog.
#include "app/SpdLog.h"

#include <spdlog/logger.h>
#include <spdlog/sinks/stdout_sinks.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace usdlive::server {

namespace {

using Json = nlohmann::json;

// Escapes control characters that JSON allows but terminals obey: DEL, and U+0080 to U+009F.
std::string withoutControls(const std::string& json) {
    std::string text;
    for (std::size_t i = 0; i < json.size(); ++i) {
        const auto byte = static_cast<unsigned char>(json[i]);
        const auto next = i + 1 < json.size() ? static_cast<unsigned char>(json[i + 1]) : 0;
        const bool isC1 = byte == 0xc2 && next >= 0x80 && next < 0xa0;
        if (byte != 0x7f && !isC1) {
            text += json[i];
            continue;
        }
        char escaped[8];
        std::snprintf(escaped, sizeof escaped, "\\u%04x", isC1 ? next : byte);
        text += escaped;
        if (isC1) ++i;
    }
    return text;
}

std::string quoted(std::string_view text) {
    return withoutControls(Json(text).dump(-1, ' ', false, Json::error_handler_t::replace));
}

bool isPlain(std::string_view text) {
    return !text.empty() && std::ranges::all_of(text, [](unsigned char byte) {
        return byte > 0x20 && byte < 0x7f && byte != '"' && byte != '\\' && byte != '=';
    });
}

std::string rendered(std::string_view text, LogFormat format) {
    return format == LogFormat::Text && isPlain(text) ? std::string(text) : quoted(text);
}

std::string valueOf(const LogField& field, LogFormat format) {
    if (const auto* number = std::get_if<std::int64_t>(&field.value))
        return std::to_string(*number);
    return rendered(std::get<std::string_view>(field.value), format);
}

class SpdLog final : public Log {
public:
    SpdLog(const std::string& level, LogFormat format, const std::string& project)
        : format_(format), logger_("usdlive", std::make_shared<spdlog::sinks::stderr_sink_mt>()) {
        if (!project.empty()) tail_ = rendered({"project", project});
        logger_.set_level(spdlog::level::from_str(level));
        logger_.flush_on(spdlog::level::trace);
        logger_.set_pattern(format == LogFormat::Json
                                ? R"({"time":"%Y-%m-%dT%H:%M:%S.%e%z","level":"%l",%v})"
                                : "%Y-%m-%d %H:%M:%S.%e %l: %v");
    }

    void write(LogLevel level, std::string_view event,
               std::initializer_list<LogField> fields) override {
        const auto spdLevel = toSpd(level);
        if (!logger_.should_log(spdLevel)) return;
        std::string line =
            format_ == LogFormat::Json ? "\"event\":" + quoted(event) : std::string(event);
        for (const LogField& field : fields) line += rendered(field);
        line += tail_;
        logger_.log(spdLevel, spdlog::string_view_t(line.data(), line.size()));
    }

private:
    std::string rendered(const LogField& field) const {
        const std::string name = format_ == LogFormat::Json ? "," + quoted(field.name) + ":"
                                                            : " " + std::string(field.name) + "=";
        return name + valueOf(field, format_);
    }

    static spdlog::level::level_enum toSpd(LogLevel level) {
        switch (level) {
            case LogLevel::Debug:
                return spdlog::level::debug;
            case LogLevel::Info:
                return spdlog::level::info;
            case LogLevel::Warning:
                return spdlog::level::warn;
            case LogLevel::Error:
                return spdlog::level::err;
        }
        return spdlog::level::info;
    }

    const LogFormat format_;
    std::string tail_;  // appended to each line
    spdlog::logger logger_;
};

}  // namespace

std::unique_ptr<Log> createSpdLog(const std::string& level, LogFormat format,
                                  const std::string& project) {
    return std::make_unique<SpdLog>(level, format, project);
}

}  // namespace usdlive::server
