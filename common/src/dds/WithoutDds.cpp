// Stands in for DDS in a build without it (USDLIVE_DDS=OFF).
#include "usdlive/common/dds/Domain.h"

namespace usdlive::dds {

void setDomainLog(DomainLog) {}

}  // namespace usdlive::dds
