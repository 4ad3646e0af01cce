# The options of a build, and the compiler settings that all our targets share.

option(USDLIVE_SERVER "Build the server" ON)
option(USDLIVE_DDS "Speak DDS, too, which needs Cyclone DDS" ON)
option(USDLIVE_PYTHON "Build the Python extension" ON)
option(USDLIVE_TESTS "Build tests and benchmarks" ${PROJECT_IS_TOP_LEVEL})
set(USDLIVE_SANITIZE "" CACHE STRING "Sanitizers: empty, or such as address;undefined or thread")
option(USDLIVE_FUZZ "Build the fuzz targets, which need Clang" OFF)

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)

if(NOT CMAKE_BUILD_TYPE)
    set(CMAKE_BUILD_TYPE Release CACHE STRING "Build type" FORCE)
endif()
# Without NDEBUG, because asserts are on in every build.
set(CMAKE_CXX_FLAGS_RELEASE "-O2 -g1")
if(SKBUILD)  # what pip builds is stripped
    set(CMAKE_CXX_FLAGS_RELEASE "-O2")
endif()
set(CMAKE_CXX_FLAGS_DEBUG "-O0 -g")

# ccache reuses precompiled headers only if it ignores their macros and times, and only with hashes
# of the text of their includes (DEPEND). After preprocessing, headers that differ in a comment are
# identical, but #pragma once distinguishes them, and the definitions of the older one would be
# repeated.
find_program(USDLIVE_CCACHE ccache)
if(USDLIVE_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
    set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env
        CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime
        CCACHE_DEPEND=true CCACHE_BASEDIR=${PROJECT_SOURCE_DIR} ${USDLIVE_CCACHE})
    if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
        add_compile_options(-fpch-preprocess)
    endif()
endif()

find_program(USDLIVE_MOLD mold)
find_program(USDLIVE_LLD ld.lld)
if(USDLIVE_MOLD)
    add_link_options(-fuse-ld=mold)
elseif(USDLIVE_LLD)
    add_link_options(-fuse-ld=lld)
endif()

if(USDLIVE_SANITIZE)
    list(JOIN USDLIVE_SANITIZE "," sanitizers)
    add_compile_options(-fsanitize=${sanitizers} -fno-omit-frame-pointer -fno-sanitize-recover=all)
    if("thread" IN_LIST USDLIVE_SANITIZE AND CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
        add_compile_options(-Wno-tsan)  # OpenUSD's headers have fences, which TSan does not support
    endif()
    add_link_options(-fsanitize=${sanitizers})
    add_compile_definitions(USDLIVE_SANITIZED)
endif()

# In a unity build, more sources in one file compile faster: 20 take a quarter less than 8, and up to
# 1.5 GB of memory.
set(CMAKE_UNITY_BUILD_BATCH_SIZE 20)

# All programs are in one folder, because `usdlive serve` searches `usdlive-server` in its own
# folder.
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/bin)
