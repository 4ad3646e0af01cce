# Finds the libraries of the system, with or without a CMake package. Also installed beside
# usdlive's package, which has to find the same libraries.
include_guard()

find_package(Threads REQUIRED)
find_package(OpenSSL 3 REQUIRED)
find_package(nlohmann_json 3 REQUIRED)
find_package(zstd CONFIG REQUIRED)
find_package(tl-expected CONFIG REQUIRED)
find_package(Boost 1.81 CONFIG REQUIRED)
find_package(CycloneDDS 0.10 CONFIG REQUIRED)

# Only the headers, because Debian's package also requires the static library.
find_path(USDLIVE_FLATBUFFERS_INCLUDE flatbuffers/flatbuffers.h REQUIRED)
if(NOT TARGET usdlive::flatbuffers)
    add_library(usdlive::flatbuffers INTERFACE IMPORTED)
    target_include_directories(usdlive::flatbuffers SYSTEM INTERFACE ${USDLIVE_FLATBUFFERS_INCLUDE})
endif()
