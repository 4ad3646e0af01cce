# Functions that create a target from all sources of its folders.

set(USDLIVE_WARNINGS -Wall -Wextra -Wpedantic -Werror)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    # GCC 12 wrongly reports uses of a std::variant's other alternatives, and writes past the end of
    # a std::vector after insert().
    list(APPEND USDLIVE_WARNINGS -Wno-maybe-uninitialized -Wno-stringop-overflow -Wno-array-bounds)
    if(CMAKE_UNITY_BUILD)
        # In a unity build, private parts of one .cpp seem to be in a header.
        list(APPEND USDLIVE_WARNINGS $<$<COMPILE_LANGUAGE:CXX>:-Wno-subobject-linkage>)
    endif()
elseif(CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
    # Comparisons of TfWeakPtr, which C++20 can also reverse.
    list(APPEND USDLIVE_WARNINGS -Wno-ambiguous-reversed-operator)
endif()

# usdlive_library(name PUBLIC_INCLUDE dir FOLDERS folder...): a static library of all .cpp in the
# folders, which are listed again when one is added. In a unity build several are compiled as one
# file. Without any .cpp it is an INTERFACE library of that name, so that others can still link to
# it. Links are added with usdlive_link.
function(usdlive_library name)
    cmake_parse_arguments(ARG "" "PUBLIC_INCLUDE" "FOLDERS;SOURCES" ${ARGN})
    usdlive_sources(sources ${ARG_FOLDERS})
    list(APPEND sources ${ARG_SOURCES})
    if(sources)
        add_library(${name} STATIC ${sources})
        target_compile_options(${name} PRIVATE ${USDLIVE_WARNINGS})
        set(scope PUBLIC)
    else()
        add_library(${name} INTERFACE)
        set(scope INTERFACE)
    endif()
    target_include_directories(${name} ${scope}
        $<BUILD_INTERFACE:${ARG_PUBLIC_INCLUDE}> $<INSTALL_INTERFACE:include>)
endfunction()

# usdlive_link(name PUBLIC ... PRIVATE ...): target_link_libraries, also for a library without
# sources.
function(usdlive_link name)
    cmake_parse_arguments(ARG "" "" "PUBLIC;PRIVATE" ${ARGN})
    get_target_property(type ${name} TYPE)
    if(type STREQUAL "INTERFACE_LIBRARY")
        target_link_libraries(${name} INTERFACE ${ARG_PUBLIC})
    else()
        target_link_libraries(${name} PUBLIC ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE})
    endif()
endfunction()

# usdlive_executable(name FOLDERS folder... LINK library...): an executable of all .cpp in the
# folders. Creates none without any .cpp.
function(usdlive_executable name)
    cmake_parse_arguments(ARG "" "" "FOLDERS;SOURCES;LINK" ${ARGN})
    usdlive_sources(sources ${ARG_FOLDERS})
    list(APPEND sources ${ARG_SOURCES})
    if(sources)
        add_executable(${name} ${sources})
        target_compile_options(${name} PRIVATE ${USDLIVE_WARNINGS})
        # Some compile one file of a library again.
        set_target_properties(${name} PROPERTIES UNITY_BUILD OFF)
        target_link_libraries(${name} PRIVATE ${ARG_LINK})
    endif()
endfunction()

# Sources that a build leaves out: those that need Cyclone DDS, or those that take their place. Elsewhere no code
# asks whether there is DDS.
set(USDLIVE_LEFT_OUT "/WithoutDds\\.cpp$")
if(NOT USDLIVE_DDS)
    string(CONCAT USDLIVE_LEFT_OUT
        "/src/dds/(Domain|StateSamples|SecurityConfig|Topics)\\.cpp$"
        "|/src/transport/Dds(Connection|Projects|Server|Session|StatePublisher)\\.cpp$"
        "|/tests/.*/(StateSamplesTest|TransportContractTest)\\.cpp$")
endif()

# Lists all .cpp under folders of the current source folder.
function(usdlive_sources out)
    set(patterns ${ARGN})
    list(TRANSFORM patterns PREPEND ${CMAKE_CURRENT_SOURCE_DIR}/)
    list(TRANSFORM patterns APPEND /*.cpp)
    set(sources)
    if(patterns)
        file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${patterns})
        list(FILTER sources EXCLUDE REGEX "${USDLIVE_LEFT_OUT}")
    endif()
    set(${out} ${sources} PARENT_SCOPE)
endfunction()

# The standard headers that are included nearly everywhere.
set(USDLIVE_STD_HEADERS
    <algorithm> <functional> <map> <memory> <optional> <set> <span> <string> <string_view> <unordered_map>
    <variant> <vector>)
set(USDLIVE_OWN_HEADERS
    <usdlive/common/layer/LayerDoc.h> <usdlive/common/protocol/Control.h> <usdlive/common/protocol/Frame.h>)
set(USDLIVE_PXR_HEADERS
    <pxr/base/vt/array.h> <pxr/base/vt/dictionary.h> <pxr/base/vt/value.h> <pxr/usd/sdf/layer.h>
    <pxr/usd/sdf/listOp.h> <pxr/usd/sdf/schema.h> <pxr/usd/sdf/types.h>)

# usdlive_pch(name header...): creates the target's own precompiled header, which others may share.
function(usdlive_pch name)
    get_target_property(type ${name} TYPE)
    if(NOT type STREQUAL "INTERFACE_LIBRARY")
        target_precompile_headers(${name} PRIVATE ${ARGN})
        usdlive_compile_alike(${name})
    endif()
endfunction()

# usdlive_share_pch(owner name...): shares the owner's precompiled header with targets of the same
# compile options.
function(usdlive_share_pch owner)
    get_target_property(headers ${owner} PRECOMPILE_HEADERS)
    foreach(name ${ARGN})
        if(TARGET ${name} AND headers)
            get_target_property(type ${name} TYPE)
            if(NOT type STREQUAL "INTERFACE_LIBRARY")
                target_precompile_headers(${name} REUSE_FROM ${owner})
                usdlive_compile_alike(${name})
            endif()
        endif()
    endforeach()
endfunction()

# Targets that share a precompiled header need the same options: executables use those of libraries.
function(usdlive_compile_alike name)
    get_target_property(type ${name} TYPE)
    if(type STREQUAL "EXECUTABLE")
        target_compile_options(${name} PRIVATE -fPIC)
    endif()
endfunction()
