// Tests uploads of files (FI7): several editors, and the real project in one process.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "unit/client/usd/MemoryServer.h"
#include "usd/editor/ClientInternals.h"
#include "usdlive/client/usd/Client.h"

using namespace usdlive;
namespace event = client::event;
namespace fs = std::filesystem;

namespace {

class UploadTest : public ::testing::Test {
protected:
    std::unique_ptr<Client> connect(const std::string& user) {
        Client::Options options;
        options.user = user;
        auto client = client::ClientInternals::connectBy(server.connect(), options);
        EXPECT_TRUE(client) << client.error().message;
        return std::move(*client);
    }

    tests::MemoryServer server{std::map<LayerId, LayerDoc>{}};
};

fs::path uploadFolder(const std::string& name) {
    const auto folder =
        fs::temp_directory_path() / ("usdlive-upload-test-" + std::to_string(getpid())) / name;
    fs::remove_all(folder);
    fs::create_directories(folder);
    return folder;
}

fs::path localFile(const std::string& name, const std::string& content) {
    const fs::path file = uploadFolder(name) / name;
    std::ofstream(file, std::ios::binary) << content;
    return file;
}

std::string contentText(const Bytes& bytes) { return {bytes.begin(), bytes.end()}; }

}  // namespace

TEST_F(UploadTest, FI7AFileBecomesPartOfTheProject) {
    const auto ada = connect("ada");
    std::string large(3'000'000, 'a');
    for (std::size_t at = 0; at < large.size(); at += 7) large[at] = char(at * at >> 8);
    for (const auto& [name, content] :
         {std::pair{"small.png", std::string("small")}, std::pair{"large.png", large}}) {
        const auto done = ada->upload(localFile(name, content), name);
        ASSERT_TRUE(done) << done.error().message;
        EXPECT_EQ(contentText(server.uploaded.at(name)), content);
    }
    EXPECT_TRUE(ada->upload(localFile("same.png", "small"), "small.png"))
        << "the content is the same";
    const auto other = localFile("other.png", "other");
    EXPECT_EQ(ada->upload(other, "small.png").error().code, ErrorCode::FileExists);
    EXPECT_EQ(contentText(server.uploaded.at("small.png")), "small");
    EXPECT_TRUE(ada->upload(other, "small.png", true));
    EXPECT_EQ(contentText(server.uploaded.at("small.png")), "other");
}

TEST_F(UploadTest, FI7AnUploadEndsWithAnEventAndTheOrderStays) {
    const auto ada = connect("ada");
    std::vector<std::pair<std::uint64_t, std::string>> ends;
    ada->setEventHandler([&](const client::Event& one) {
        if (const auto* done = std::get_if<event::Uploaded>(&one))
            ends.emplace_back(done->request, done->path);
        if (const auto* failed = std::get_if<event::UploadFailed>(&one))
            ends.emplace_back(failed->request, errorName(failed->reason.code));
        EXPECT_FALSE(std::holds_alternative<event::ServerError>(one));
        EXPECT_FALSE(std::holds_alternative<event::Answered<UploadFile>>(one));
    });
    const auto a = localFile("a.png", std::string(1'000'000, 'a')), b = localFile("b.png", "b");
    const std::vector numbers{ada->requestUpload(a, "a.png"), ada->requestUpload(b, "a.png"),
                              ada->requestUpload(b, "b.png"),
                              ada->requestUpload("/nowhere/c.png", "c.png"),
                              ada->requestUpload(b, "../b.png")};
    EXPECT_TRUE(server.uploaded.empty()) << "ticks do the work";
    for (int i = 0; i < 2'000 && ends.size() < numbers.size(); ++i) {
        ada->tick();
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    const std::vector<std::pair<std::uint64_t, std::string>> expected{
        {numbers[0], "a.png"},
        {numbers[1], "fileExists"},
        {numbers[2], "b.png"},
        {numbers[3], "invalidArgument"},
        {numbers[4], "invalidFileName"}};
    EXPECT_EQ(ends, expected);
}

TEST_F(UploadTest, FI7ALostConnectionEndsAnUploadAndOfflineNoneBegins) {
    const auto ada = connect("ada");
    std::vector<ErrorCode> ends;
    ada->setEventHandler([&](const client::Event& one) {
        if (const auto* failed = std::get_if<event::UploadFailed>(&one))
            ends.push_back(failed->reason.code);
    });
    const auto file = localFile("a.png", "a");
    ada->requestUpload(file, "a.png");
    ada->requestUpload(file, "b.png");
    server.setReachable(false);
    for (int i = 0; i < 1'000 && ends.size() < 2; ++i) {
        ada->tick();
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_EQ(ends, std::vector(2, ErrorCode::NotConnected));
    const auto refused = ada->upload(file, "c.png");
    EXPECT_EQ(refused.error().code, ErrorCode::NotConnected);
    EXPECT_NE(refused.error().message.find("a.png"), std::string::npos);
    server.setReachable(true);
    for (int i = 0; i < 1'000 && !ada->isConnected(); ++i) {
        ada->tick();
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    EXPECT_TRUE(ada->upload(file, "a.png"));
}

TEST_F(UploadTest, FI7WhatCannotBeReadIsRefused) {
    const auto ada = connect("ada");
    const fs::path folder = uploadFolder("upload-none");
    ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);
    for (const char* name : {"missing.png", "pipe", ""}) {
        const auto refused = ada->upload(folder / name, "a.png");
        ASSERT_FALSE(refused);
        EXPECT_EQ(refused.error().code, ErrorCode::InvalidArgument);
        EXPECT_NE(refused.error().message.find("upload-none"), std::string::npos);
    }
    EXPECT_TRUE(server.uploaded.empty());
}
