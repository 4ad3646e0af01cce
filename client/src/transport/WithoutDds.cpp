// Stands in for the DDS transport in a build without it (USDLIVE_DDS=OFF): each call says so.
#include "transport/Connection.h"

namespace usdlive::client {

namespace {

tl::unexpected<Error> builtWithoutDds() {
    return fail(ErrorCode::InvalidConfiguration,
                "addresses with dds:// cannot be used: this program was built without DDS "
                "(USDLIVE_DDS=OFF). Use the ws:// address of the server");
}

}  // namespace

Result<dds::DomainSettings> ddsSettings() { return builtWithoutDds(); }

std::string ddsIdentity(const dds::DomainSettings&) { return {}; }

Result<std::unique_ptr<Connection>> createDdsConnection(const ServerAddress&,
                                                        const dds::DomainSettings&,
                                                        Connection::Brings) {
    return builtWithoutDds();
}

Result<std::vector<DdsProject>> listDdsProjects(const dds::DomainSettings&,
                                                std::chrono::milliseconds) {
    return builtWithoutDds();
}

}  // namespace usdlive::client
