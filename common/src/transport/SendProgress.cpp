// Asks Linux about a TCP connection.
#include "usdlive/common/transport/SendProgress.h"

#include <linux/sockios.h>
#include <linux/tcp.h>  // has more than netinet/tcp.h, and cannot be included beside it
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <cstddef>

namespace usdlive {

std::optional<SendProgress> sendProgress(int socket) {
    tcp_info info{};
    socklen_t size = sizeof info;
    int waiting = 0;
    if (::getsockopt(socket, IPPROTO_TCP, TCP_INFO, &info, &size) != 0 ||
        size < offsetof(tcp_info, tcpi_bytes_acked) + sizeof info.tcpi_bytes_acked ||
        ::ioctl(socket, SIOCOUTQ, &waiting) != 0)
        return std::nullopt;
    return SendProgress{info.tcpi_bytes_acked, std::uint64_t(waiting)};
}

void limitUnsent(int socket, int bytes) {
    ::setsockopt(socket, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &bytes, sizeof bytes);
}

}  // namespace usdlive
