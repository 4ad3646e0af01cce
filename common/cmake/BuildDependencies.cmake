# Libraries of headers that only the build of usdlive itself needs.
include_guard()

find_package(nlohmann_json 3 REQUIRED)
find_package(Boost 1.81 CONFIG REQUIRED)

# Only the headers, because Debian's package also requires the static library.
find_path(USDLIVE_FLATBUFFERS_INCLUDE flatbuffers/flatbuffers.h REQUIRED)
if(NOT TARGET usdlive::flatbuffers)
    add_library(usdlive::flatbuffers INTERFACE IMPORTED)
    target_include_directories(usdlive::flatbuffers SYSTEM INTERFACE ${USDLIVE_FLATBUFFERS_INCLUDE})
endif()
