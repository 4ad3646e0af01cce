// Writes to the descriptor of standard output.
#include "cli/StandardOutput.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <iostream>
#include <string>

namespace usdlive::cli {

StandardOutput::StandardOutput() : before_(std::cout.rdbuf(this)) {
    setp(buffer_.data(), buffer_.data() + buffer_.size());
}

StandardOutput::~StandardOutput() { std::cout.rdbuf(before_); }

Result<void> StandardOutput::finish() {
    std::cout.flush();
    if (error_ == 0) return {};
    return fail(ErrorCode::StorageFailed,
                "the output is incomplete, standard output cannot be written: " +
                    std::string(std::strerror(error_)) +
                    (error_ == EPIPE ? ". The program that reads it has ended"
                                     : ". Send it to a place that can be written"));
}

int StandardOutput::overflow(int character) {
    if (!writeBuffered()) return traits_type::eof();
    if (!traits_type::eq_int_type(character, traits_type::eof())) {
        *pptr() = traits_type::to_char_type(character);
        pbump(1);
    }
    return traits_type::not_eof(character);
}

int StandardOutput::sync() { return writeBuffered() ? 0 : -1; }

bool StandardOutput::writeBuffered() {
    const char* from = pbase();
    while (error_ == 0 && from != pptr()) {
        const ssize_t written = ::write(STDOUT_FILENO, from, std::size_t(pptr() - from));
        if (written >= 0)
            from += written;
        else if (errno != EINTR)
            error_ = errno;
    }
    setp(buffer_.data(), buffer_.data() + buffer_.size());
    return error_ == 0;
}

}  // namespace usdlive::cli
