// Keeps the numbers of standard input, output and error for these.
#pragma once

namespace usdlive {

/// Gives standard input, output and error a descriptor each if the caller closed them, so that no
/// socket or file gets their number. Writing to them still fails. Call it first in main().
void reserveStandardDescriptors();

}  // namespace usdlive
