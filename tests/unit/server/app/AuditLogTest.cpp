// Tests the audit log of a running server (AU4).
#include "app/AuditLog.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <string>
#include <thread>

namespace usdlive::server {
namespace {

namespace fs = std::filesystem;

class SilentAuditLog final : public Log {
    void write(LogLevel, std::string_view, std::initializer_list<LogField>) override {}
};

TEST(AuditLog, AU4WhatCouldNotBeWrittenIsWrittenLaterAndTheRestIsCounted) {
    std::string name = fs::temp_directory_path() / "audit-XXXXXX";
    const fs::path folder = ::mkdtemp(name.data());
    const AuditFile file(folder);
    fs::create_directories(file.path());  // no file can be there
    {
        SilentAuditLog log;
        Workers workers(log);
        AuditLog audit(folder, workers, log);
        audit.record({.event = "before the beginning"});
        audit.begin();
        // Fills the queue, with as many users as LogLimit tells apart.
        for (std::size_t user = 0; user < LogLimit::kMostKeys; ++user)
            for (std::uint64_t line = 0; line < LogLimit::kLines; ++line)
                audit.record({.event = "tested", .user = "user" + std::to_string(user)});
        for (int more = 0; more < 5; ++more) audit.record({.event = "tested", .user = "late"});
        std::this_thread::sleep_for(std::chrono::milliseconds(200));  // it has tried and failed
        fs::remove(file.path());
        audit.record({.event = "tested", .user = "last"});
        // It does not wait until the server ends.
        const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
        while (!fs::exists(file.path()) && std::chrono::steady_clock::now() < end)
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        EXPECT_TRUE(fs::exists(file.path()));
    }
    std::uint64_t tested = 0, lost = 0;
    const auto found = file.read([&](std::uint64_t, const Hash&, std::string_view line) {
        if (line.find("\"tested\"") != std::string_view::npos) ++tested;
        if (line.find("\"events lost\"") != std::string_view::npos) ++lost;
        EXPECT_EQ(line.find("before the beginning"), std::string_view::npos);
    });
    ASSERT_TRUE(found);
    EXPECT_EQ(found->damage, std::nullopt);
    EXPECT_EQ(tested, AuditLog::kMostWaiting);
    EXPECT_EQ(lost, 1);
    fs::remove_all(folder);
}

}  // namespace
}  // namespace usdlive::server
