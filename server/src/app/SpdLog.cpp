#include "usdlive/server/app/SpdLog.h"

#include <spdlog/logger.h>
#include <spdlog/sinks/stdout_sinks.h>

#include <nlohmann/json.hpp>

namespace usdlive::server {

namespace {

using Json = nlohmann::json;

std::string quoted(std::string_view text) {
    return Json(text).dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string rendered(std::string_view text, LogFormat format) {
    const bool plain = text.find_first_of(" \"\\=\n\t") == std::string_view::npos;
    return format == LogFormat::Text && plain && !text.empty() ? std::string(text) : quoted(text);
}

std::string rendered(const LogField& field, LogFormat format) {
    if (const auto* number = std::get_if<std::int64_t>(&field.value))
        return std::to_string(*number);
    return rendered(std::get<std::string_view>(field.value), format);
}

class SpdLog final : public Log {
public:
    SpdLog(const std::string& level, LogFormat format)
        : format_(format), logger_("usdlive", std::make_shared<spdlog::sinks::stderr_sink_mt>()) {
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
        for (const LogField& field : fields) {
            line += format_ == LogFormat::Json ? "," + quoted(field.name) + ":"
                                               : " " + std::string(field.name) + "=";
            line += rendered(field, format_);
        }
        logger_.log(spdLevel, spdlog::string_view_t(line.data(), line.size()));
    }

private:
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
    spdlog::logger logger_;
};

}  // namespace

std::unique_ptr<Log> createSpdLog(const std::string& level, LogFormat format) {
    return std::make_unique<SpdLog>(level, format);
}

}  // namespace usdlive::server
