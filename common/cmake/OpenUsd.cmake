# Defines usdlive::openusd, the one OpenUSD of the build:
# - by default the official wheel usd-core (libraries) with the headers of pxr-*-dev and tbb-devel,
#   from two Python environments, USDLIVE_PRODUCT_ENV and USDLIVE_HEADERS_ENV. Without the first,
#   the usd-core of the Python in use is taken. Without the second, such an environment is created;
# - with USDLIVE_OPENUSD_ROOT a stock installation, for example that of an editor.
# With either, sources include the stock paths (pxr/usd/sdf/layer.h) and write `pxr::`.
include_guard()

set(USDLIVE_HEADERS_ENV "" CACHE PATH "Python environment that holds pxr-*-dev and tbb-devel")
set(USDLIVE_PRODUCT_ENV "" CACHE PATH "Python environment that holds usd-core")
set(USDLIVE_OPENUSD_ROOT "" CACHE PATH "A stock OpenUSD installation to use instead")

if(USDLIVE_PRODUCT_ENV AND NOT Python_EXECUTABLE AND EXISTS ${USDLIVE_PRODUCT_ENV}/bin/python)
    set(Python_EXECUTABLE ${USDLIVE_PRODUCT_ENV}/bin/python)
endif()
find_package(Python 3 REQUIRED COMPONENTS Interpreter Development.Module Development.Embed)

function(usdlive_openusd_from_stock)
    find_package(pxr CONFIG REQUIRED PATHS ${USDLIVE_OPENUSD_ROOT} NO_DEFAULT_PATH)
    target_include_directories(usdlive::openusd SYSTEM INTERFACE ${PXR_INCLUDE_DIRS})
    target_link_libraries(usdlive::openusd INTERFACE ${PXR_LIBRARIES})
endfunction()

# Finds exactly one matching file, or ends with an error that says what to do.
function(usdlive_find_one out what)
    file(GLOB found ${ARGN})
    list(LENGTH found count)
    if(NOT count EQUAL 1)
        message(FATAL_ERROR "${what}: expected one file like ${ARGN}, found ${count}. "
            "Run `./run setup`, or set USDLIVE_HEADERS_ENV and USDLIVE_PRODUCT_ENV.")
    endif()
    set(${out} ${found} PARENT_SCOPE)
endfunction()

# Finds the site-packages folder with usd-core.
function(usdlive_usd_core_site out)
    if(USDLIVE_PRODUCT_ENV)
        set(${out} ${USDLIVE_PRODUCT_ENV}/${usdlive_site} PARENT_SCOPE)
        return()
    endif()
    execute_process(
        COMMAND ${Python_EXECUTABLE} -c "import os, pxr; print(os.path.dirname(pxr.__path__[0]))"
        OUTPUT_VARIABLE site OUTPUT_STRIP_TRAILING_WHITESPACE RESULT_VARIABLE status)
    if(NOT status EQUAL 0)
        message(FATAL_ERROR "${Python_EXECUTABLE} has no usd-core. Run `./run setup`, "
            "or set USDLIVE_PRODUCT_ENV or USDLIVE_OPENUSD_ROOT.")
    endif()
    set(${out} ${site} PARENT_SCOPE)
endfunction()

# Creates an environment for the headers of a `pip install .` build. tbb-devel cannot be a plain
# requirement (it requires a tbb that PyPI does not have), and pxr-pcp-dev would bring the wrong
# TBB. So the complete list is installed without dependencies.
function(usdlive_make_headers_env folder requirements)
    if(NOT EXISTS ${folder}/.complete)
        message(STATUS "Making the environment of OpenUSD's headers in ${folder}")
        set(clean ${CMAKE_COMMAND} -E env --unset=PYTHONPATH --unset=PYTHONHOME)
        execute_process(COMMAND ${clean} ${Python_EXECUTABLE} -m venv ${folder}
            COMMAND_ERROR_IS_FATAL ANY)
        execute_process(COMMAND ${clean} ${folder}/bin/python -m pip install --quiet --no-input
            --disable-pip-version-check --no-deps -r ${requirements} COMMAND_ERROR_IS_FATAL ANY)
        file(TOUCH ${folder}/.complete)
    endif()
endfunction()

# The wheels have pxr/sdf/layer.h instead of pxr/usd/sdf/layer.h as in a stock OpenUSD. Links in
# `folder` add the stock paths.
function(usdlive_link_stock_paths folder)
    foreach(include ${ARGN})
        file(GLOB libraries ${include}/pxr/*)
        foreach(library ${libraries})
            get_filename_component(name ${library} NAME)
            set(group base)
            if(name MATCHES "^(ar|kind|pcp|sdf)$")
                set(group usd)
            endif()
            file(MAKE_DIRECTORY ${folder}/pxr/${group})
            file(CREATE_LINK ${library} ${folder}/pxr/${group}/${name} SYMBOLIC)
        endforeach()
    endforeach()
endfunction()

function(usdlive_openusd_from_wheels)
    set(usdlive_site lib/python${Python_VERSION_MAJOR}.${Python_VERSION_MINOR}/site-packages)
    set(requirements ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/../../.ci/requirements-headers.txt)
    set(made ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/../../build/env/headers)  # by ./run setup
    if(NOT USDLIVE_HEADERS_ENV AND IS_DIRECTORY ${made}/${usdlive_site} AND ${made}/.key IS_NEWER_THAN ${requirements})
        get_filename_component(USDLIVE_HEADERS_ENV ${made} REALPATH)
    endif()
    if(NOT USDLIVE_HEADERS_ENV AND EXISTS ${requirements})
        set(USDLIVE_HEADERS_ENV ${CMAKE_BINARY_DIR}/headers)
        usdlive_make_headers_env(${USDLIVE_HEADERS_ENV} ${requirements})
    endif()
    usdlive_usd_core_site(product)
    set(headers ${USDLIVE_HEADERS_ENV}/${usdlive_site})
    usdlive_find_one(usd "The library of usd-core" ${product}/usd_core.libs/libusd_ms-*.so)
    usdlive_find_one(tbb "TBB of usd-core" ${product}/usd_core.libs/libtbb-*.so.2)
    usdlive_find_one(layer "Headers of pxr-sdf-dev" ${headers}/pxr-sdf/include/pxr/sdf/layer.h)
    # Programs with the headers of oneTBB, a dependency of pxr-tbb-dev, crash with the TBB 2020 of
    # usd-core.
    usdlive_find_one(tbbVersion "Headers of tbb-devel 2020"
        ${USDLIVE_HEADERS_ENV}/include/tbb/tbb_stddef.h)
    file(GLOB includes ${headers}/pxr-*/include)
    set(stock ${CMAKE_BINARY_DIR}/openusd)
    usdlive_link_stock_paths(${stock} ${includes})

    target_include_directories(usdlive::openusd SYSTEM INTERFACE
        ${stock} ${includes} ${USDLIVE_HEADERS_ENV}/include ${Python_INCLUDE_DIRS})
    # usd-core has Python. Without the first definition, values that we make would have no conversion to it.
    target_compile_definitions(usdlive::openusd INTERFACE
        PXR_PYTHON_SUPPORT_ENABLED TBB_SUPPRESS_DEPRECATED_MESSAGES=1)
    # The wheel's libraries are built by GCC. Without this definition, clang has another layout of
    # TfHashMap and TfHashSet, and so of classes that contain them.
    target_compile_definitions(usdlive::openusd INTERFACE
        $<$<CXX_COMPILER_ID:Clang>:ARCH_HAS_GNU_STL_EXTENSIONS=>)
    # The order matters. A Python extension gets the interpreter's symbols from the process.
    set(isProgram $<STREQUAL:$<TARGET_PROPERTY:TYPE>,EXECUTABLE>)
    set(hasPython $<NOT:$<BOOL:$<TARGET_PROPERTY:USDLIVE_WITHOUT_PYTHON>>>)
    target_link_libraries(usdlive::openusd INTERFACE ${tbb} ${usd}
        $<$<AND:${isProgram},${hasPython}>:${Python_LIBRARIES}>)
    target_link_options(usdlive::openusd INTERFACE -Wl,--no-as-needed -Wl,--disable-new-dtags)

    # Used by InstallOpenUsd.cmake, WithoutPython.cmake and the Python package.
    set(USDLIVE_USD_LIBRARY ${usd} PARENT_SCOPE)
    file(GLOB metadata ${product}/usd_core-*.dist-info)
    string(REGEX REPLACE ".*/usd_core-(.+)[.]dist-info$" "\\1" version "${metadata}")
    set(USDLIVE_USD_CORE ${version} PARENT_SCOPE)
    set(USDLIVE_SITE ${usdlive_site} PARENT_SCOPE)
    set(USDLIVE_USD_SITE ${product} PARENT_SCOPE)
    set(USDLIVE_USD_HEADERS ${includes} PARENT_SCOPE)
    set(USDLIVE_HEADERS_ENV ${USDLIVE_HEADERS_ENV} PARENT_SCOPE)
endfunction()

if(NOT TARGET usdlive::openusd)
    add_library(usdlive::openusd INTERFACE IMPORTED GLOBAL)
    # Headers of pxr include <ext/hash_map>, which causes a warning.
    target_compile_options(usdlive::openusd INTERFACE -Wno-deprecated)
    if(USDLIVE_OPENUSD_ROOT)
        usdlive_openusd_from_stock()
    else()
        usdlive_openusd_from_wheels()
    endif()
endif()
