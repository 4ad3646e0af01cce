// Tests the owner of a file descriptor.
#include "usdlive/common/core/Descriptor.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <string_view>

using namespace usdlive;

namespace {

bool isOpen(int number) { return ::fcntl(number, F_GETFD) >= 0; }

Descriptor fileWith(std::string_view text) {
    Descriptor file(::memfd_create("test", MFD_CLOEXEC));
    EXPECT_EQ(::write(file.get(), text.data(), text.size()), ssize_t(text.size()));
    return file;
}

}  // namespace

TEST(Descriptor, IsClosedOnceByItsLastOwner) {
    int number = -1;
    {
        Descriptor file = fileWith("");
        number = file.get();
        Descriptor other;
        EXPECT_FALSE(other);
        other = std::move(file);
        EXPECT_EQ(other.get(), number);
        EXPECT_TRUE(isOpen(number));
        const Descriptor last(std::move(other));
        EXPECT_FALSE(other);
        EXPECT_TRUE(isOpen(number));
        errno = ENOSPC;
    }
    EXPECT_EQ(errno, ENOSPC);
    EXPECT_FALSE(isOpen(number));
}

TEST(Descriptor, AReleasedOneStaysOpen) {
    int number = -1;
    {
        Descriptor file = fileWith("");
        number = file.release();
        EXPECT_FALSE(file);
    }
    EXPECT_TRUE(isOpen(number));
    ::close(number);
}

TEST(Descriptor, ReadsAsMuchOfAPartAsTheFileHas) {
    const Descriptor file = fileWith("brick");
    std::array<std::uint8_t, 4> part{};
    EXPECT_EQ(readPart(file, 0, part), 4U);
    EXPECT_EQ(part[3], 'c');
    EXPECT_EQ(readPart(file, 3, part), 2U);
    EXPECT_EQ(part[0], 'c');
    EXPECT_EQ(readPart(file, 5, part), 0U);
    EXPECT_EQ(readPart(Descriptor(), 0, part), std::nullopt);
    EXPECT_EQ(errno, EBADF);
}
