# Functions with which every folder becomes a target from all of its sources.

set(USDLIVE_WARNINGS -Wall -Wextra -Wpedantic -Werror)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    # GCC 12 sees members of a std::variant's other alternatives, and writes past the end of a
    # std::vector that insert() has just made larger.
    list(APPEND USDLIVE_WARNINGS -Wno-maybe-uninitialized -Wno-stringop-overflow -Wno-array-bounds)
    if(CMAKE_UNITY_BUILD)
        # What is private to one .cpp seems to be in a header where another one includes it.
        list(APPEND USDLIVE_WARNINGS $<$<COMPILE_LANGUAGE:CXX>:-Wno-subobject-linkage>)
    endif()
elseif(CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
    # Of the comparisons of TfWeakPtr, which C++20 can also read from right to left.
    list(APPEND USDLIVE_WARNINGS -Wno-ambiguous-reversed-operator)
endif()

# usdlive_library(name PUBLIC_INCLUDE dir FOLDERS folder...): a static library of all .cpp in the folders,
# found again whenever one is added; of several a file where the preset says so. Without any, an INTERFACE library of the same name, so that the
# others still link to it. Links are given with usdlive_link.
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

# usdlive_link(name PUBLIC ... PRIVATE ...): target_link_libraries, also for a library without sources.
function(usdlive_link name)
    cmake_parse_arguments(ARG "" "" "PUBLIC;PRIVATE" ${ARGN})
    get_target_property(type ${name} TYPE)
    if(type STREQUAL "INTERFACE_LIBRARY")
        target_link_libraries(${name} INTERFACE ${ARG_PUBLIC})
    else()
        target_link_libraries(${name} PUBLIC ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE})
    endif()
endfunction()

# usdlive_executable(name FOLDERS folder... LINK library...): an executable of all .cpp in the folders;
# none without any.
function(usdlive_executable name)
    cmake_parse_arguments(ARG "" "" "FOLDERS;SOURCES;LINK" ${ARGN})
    usdlive_sources(sources ${ARG_FOLDERS})
    list(APPEND sources ${ARG_SOURCES})
    if(sources)
        add_executable(${name} ${sources})
        target_compile_options(${name} PRIVATE ${USDLIVE_WARNINGS})
        # Some take one file of a library anew.
        set_target_properties(${name} PROPERTIES UNITY_BUILD OFF)
        target_link_libraries(${name} PRIVATE ${ARG_LINK})
    endif()
endfunction()

# All .cpp under the folders of the current source folder.
function(usdlive_sources out)
    set(patterns ${ARGN})
    list(TRANSFORM patterns PREPEND ${CMAKE_CURRENT_SOURCE_DIR}/)
    list(TRANSFORM patterns APPEND /*.cpp)
    set(sources)
    if(patterns)
        file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${patterns})
    endif()
    set(${out} ${sources} PARENT_SCOPE)
endfunction()

# What is included nearly everywhere.
set(USDLIVE_STD_HEADERS
    <algorithm> <functional> <map> <memory> <optional> <set> <span> <string> <string_view> <unordered_map>
    <variant> <vector>)
set(USDLIVE_OWN_HEADERS
    <usdlive/common/layer/LayerDoc.h> <usdlive/common/protocol/Control.h> <usdlive/common/protocol/Frame.h>)
set(USDLIVE_PXR_HEADERS
    <pxr/base/vt/array.h> <pxr/base/vt/dictionary.h> <pxr/base/vt/value.h> <pxr/usd/sdf/layer.h>
    <pxr/usd/sdf/listOp.h> <pxr/usd/sdf/schema.h> <pxr/usd/sdf/types.h>)

# usdlive_pch(name header...): the target's own precompiled header, which others may share.
function(usdlive_pch name)
    get_target_property(type ${name} TYPE)
    if(NOT type STREQUAL "INTERFACE_LIBRARY")
        target_precompile_headers(${name} PRIVATE ${ARGN})
        usdlive_compile_alike(${name})
    endif()
endfunction()

# usdlive_share_pch(owner name...): that of the owner, in targets whose compile options are the same.
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

# What shares a precompiled header is compiled alike: executables as libraries.
function(usdlive_compile_alike name)
    get_target_property(type ${name} TYPE)
    if(type STREQUAL "EXECUTABLE")
        target_compile_options(${name} PRIVATE -fPIC)
    endif()
endfunction()
