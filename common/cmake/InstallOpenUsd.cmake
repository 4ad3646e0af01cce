# Installs the build's OpenUSD beside the package, so that the package works without the build's
# environments: lib/usdlive holds the libraries and plugins of usd-core, and the headers of OpenUSD,
# TBB and Python that our headers include. InstalledOpenUsd.cmake finds them again. OpenUsd.cmake
# sets USDLIVE_USD_SITE, USDLIVE_USD_HEADERS and USDLIVE_HEADERS_ENV.
include_guard()

set(USDLIVE_INSTALLED_USD ${CMAKE_INSTALL_LIBDIR}/usdlive)
file(RELATIVE_PATH USDLIVE_FROM_PROGRAMS /${CMAKE_INSTALL_BINDIR} /${USDLIVE_INSTALLED_USD}/usd_core.libs)

# The libraries for programs. OpenUSD searches its plugins in ../pxr/pluginfo relative to its
# libraries.
function(usdlive_install_usd_libraries)
    install(DIRECTORY ${USDLIVE_USD_SITE}/usd_core.libs DESTINATION ${USDLIVE_INSTALLED_USD}
        USE_SOURCE_PERMISSIONS COMPONENT programs)
    install(DIRECTORY ${USDLIVE_USD_SITE}/pxr/pluginfo DESTINATION ${USDLIVE_INSTALLED_USD}/pxr
        COMPONENT programs)
endfunction()

# The headers, in the folders of the wheels (pxr/sdf) and of a stock OpenUSD (pxr/usd/sdf).
function(usdlive_install_usd_headers)
    set(folder ${USDLIVE_INSTALLED_USD}/include)
    foreach(include ${USDLIVE_USD_HEADERS})
        install(DIRECTORY ${include}/pxr DESTINATION ${folder})
    endforeach()
    # The build's links to these headers are absolute; those of the package must not be.
    set(links ${PROJECT_BINARY_DIR}/openusd-installed)
    file(GLOB stock RELATIVE ${PROJECT_BINARY_DIR}/openusd ${PROJECT_BINARY_DIR}/openusd/pxr/*/*)
    foreach(link ${stock})
        get_filename_component(library ${link} NAME)
        get_filename_component(group ${link} DIRECTORY)
        file(MAKE_DIRECTORY ${links}/${group})
        file(CREATE_LINK ../${library} ${links}/${link} SYMBOLIC)
    endforeach()
    install(DIRECTORY ${links}/pxr DESTINATION ${folder})
    install(DIRECTORY ${USDLIVE_HEADERS_ENV}/include/tbb ${USDLIVE_HEADERS_ENV}/include/serial
        DESTINATION ${folder})
    foreach(include ${Python_INCLUDE_DIRS})
        install(DIRECTORY ${include}/ DESTINATION ${folder}/python)
        # Debian's pyconfig.h includes the file of the architecture by its path.
        get_filename_component(name ${include} NAME)
        set(arch ${CMAKE_LIBRARY_ARCHITECTURE}/${name})
        if(EXISTS /usr/include/${arch}/pyconfig.h)
            install(FILES /usr/include/${arch}/pyconfig.h DESTINATION ${folder}/python/${arch})
        endif()
    endforeach()
endfunction()

# usdlive_install_license(name file...): installs the licence of a copied component, in a folder of
# its own.
function(usdlive_install_license name component)
    foreach(pattern ${ARGN})
        file(GLOB files ${pattern})
        list(APPEND found ${files})
    endforeach()
    if(NOT found)
        message(FATAL_ERROR "The licence of ${name} is not at ${ARGN}: it cannot be installed.")
    endif()
    install(FILES ${found} DESTINATION ${CMAKE_INSTALL_DOCDIR}/licenses/${name} COMPONENT ${component})
endfunction()

function(usdlive_install_licenses)
    usdlive_install_license(usd-core programs ${USDLIVE_USD_SITE}/usd_core-*.dist-info/licenses/*)
    set(site ${USDLIVE_HEADERS_ENV}/${USDLIVE_SITE})
    usdlive_install_license(openusd Unspecified ${site}/pxr_sdf_dev-*.dist-info/licenses/*)
    usdlive_install_license(tbb Unspecified ${USDLIVE_HEADERS_ENV}/share/doc/pstl/LICENSE.txt)
    usdlive_install_license(python Unspecified ${Python_STDLIB}/LICENSE.txt
        /usr/share/doc/libpython${Python_VERSION_MAJOR}.${Python_VERSION_MINOR}-dev/copyright)
endfunction()

usdlive_install_usd_libraries()
usdlive_install_usd_headers()
usdlive_install_licenses()
