# Finds the libraries that programs with the client need. Also installed beside usdlive's package,
# which has to find the same libraries.
include_guard()

find_package(Threads REQUIRED)
find_package(OpenSSL 3 REQUIRED)
find_package(zstd CONFIG REQUIRED)
find_package(tl-expected CONFIG REQUIRED)
if(USDLIVE_DDS)
    find_package(CycloneDDS 0.10 CONFIG REQUIRED)
endif()
