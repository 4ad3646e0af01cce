// Stands in for the DDS transport in a build without it (USDLIVE_DDS=OFF): the call says so.
#include "transport/DdsServer.h"

namespace usdlive::server {

Result<std::unique_ptr<Transport>> createDdsServer(boost::asio::io_context&, DdsServerOptions,
                                                   SessionHandler&, Background, Log&) {
    return fail(ErrorCode::InvalidConfiguration,
                "cannot serve over DDS: this server was built without DDS (USDLIVE_DDS=OFF). Start "
                "it without --dds");
}

}  // namespace usdlive::server
