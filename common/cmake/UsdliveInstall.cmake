# The installation: in a wheel the extension and the programs, otherwise the programs and the C++
# client as a CMake package, with the OpenUSD of the build.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

function(usdlive_install_wheel)
    set_target_properties(_usdlive PROPERTIES INSTALL_RPATH "$ORIGIN/../usd_core.libs")
    install(TARGETS _usdlive LIBRARY DESTINATION usdlive)
    install(FILES ${PROJECT_BINARY_DIR}/python/usdlive/_error_code.py
        ${PROJECT_BINARY_DIR}/python/usdlive/schemas.py DESTINATION usdlive)
    usdlive_install_usd_plugins(usdlive/_plugins ../../../usd_core.libs)
    # The path from bin/ of an environment, or of a system like Debian's, to the usd-core beside the
    # package.
    set(python lib/python${Python_VERSION_MAJOR}.${Python_VERSION_MINOR})
    set_target_properties(usdlive usdlive-server PROPERTIES INSTALL_RPATH
        "$ORIGIN/../${python}/site-packages/usd_core.libs;$ORIGIN/../${python}/dist-packages/usd_core.libs")
    install(TARGETS usdlive usdlive-server RUNTIME DESTINATION ${SKBUILD_SCRIPTS_DIR})
endfunction()

# All headers of client/include, and those of common and the generated ones that they include, directly or not.
function(usdlive_install_headers)
    set(client ${PROJECT_SOURCE_DIR}/client/include)
    install(DIRECTORY ${client}/ DESTINATION include)
    file(GLOB_RECURSE waiting CONFIGURE_DEPENDS ${client}/*.h)
    set(seen)
    while(waiting)
        list(POP_FRONT waiting header)
        file(STRINGS ${header} includes REGEX "^#include \"usdlive/common/")
        # The list of what is installed follows the includes.
        set_property(DIRECTORY ${PROJECT_SOURCE_DIR} APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${header})
        foreach(include ${includes})
            string(REGEX REPLACE "^#include \"([^\"]+)\".*" "\\1" name ${include})
            if(NOT name IN_LIST seen)
                list(APPEND seen ${name})
                get_filename_component(folder ${name} DIRECTORY)
                if(EXISTS ${PROJECT_SOURCE_DIR}/common/include/${name})
                    set(file ${PROJECT_SOURCE_DIR}/common/include/${name})
                    list(APPEND waiting ${file})
                else()
                    set(file ${PROJECT_BINARY_DIR}/generated/${name})
                endif()
                install(FILES ${file} DESTINATION include/${folder})
            endif()
        endforeach()
    endwhile()
endfunction()

function(usdlive_install_package)
    foreach(program usdlive usdlive-server)
        if(TARGET ${program})
            if(USDLIVE_OPENUSD_ROOT)
                set_target_properties(${program} PROPERTIES INSTALL_RPATH_USE_LINK_PATH ON)
            else()
                set_target_properties(${program} PROPERTIES INSTALL_RPATH "$ORIGIN/${USDLIVE_FROM_PROGRAMS}")
            endif()
            install(TARGETS ${program} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT programs)
        endif()
    endforeach()

    if(USDLIVE_OPENUSD_ROOT)
        usdlive_install_usd_plugins(${CMAKE_INSTALL_LIBDIR}/usdlive/plugins "" COMPONENT plugins)
    else()
        usdlive_install_usd_plugins(${USDLIVE_INSTALLED_USD}/plugins ../../usd_core.libs
            COMPONENT plugins)
    endif()

    foreach(library common common_dds common_fetch common_net common_usd client_session client_transport
            client_work client)
        set_target_properties(usdlive_${library} PROPERTIES EXPORT_NAME ${library})
        install(TARGETS usdlive_${library} EXPORT usdliveTargets
            ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
    endforeach()
    set(package ${CMAKE_INSTALL_LIBDIR}/cmake/usdlive)
    install(EXPORT usdliveTargets NAMESPACE usdlive:: DESTINATION ${package})

    configure_package_config_file(${PROJECT_SOURCE_DIR}/common/cmake/usdliveConfig.cmake.in
        ${PROJECT_BINARY_DIR}/usdliveConfig.cmake INSTALL_DESTINATION ${package})
    write_basic_package_version_file(${PROJECT_BINARY_DIR}/usdliveConfigVersion.cmake
        COMPATIBILITY SameMinorVersion)
    install(FILES ${PROJECT_BINARY_DIR}/usdliveConfig.cmake
        ${PROJECT_BINARY_DIR}/usdliveConfigVersion.cmake
        ${PROJECT_SOURCE_DIR}/common/cmake/Dependencies.cmake
        DESTINATION ${package})
    set(openusd ${PROJECT_SOURCE_DIR}/common/cmake/OpenUsd.cmake)
    if(NOT USDLIVE_OPENUSD_ROOT)
        set(openusd ${PROJECT_BINARY_DIR}/InstalledOpenUsd.cmake)
        configure_file(${PROJECT_SOURCE_DIR}/common/cmake/InstalledOpenUsd.cmake.in ${openusd} @ONLY)
    endif()
    install(FILES ${openusd} DESTINATION ${package} RENAME OpenUsd.cmake)

    usdlive_install_headers()
endfunction()

if(SKBUILD)
    usdlive_install_wheel()
else()
    if(NOT USDLIVE_OPENUSD_ROOT)
        include(InstallOpenUsd)
    endif()
    usdlive_install_package()
endif()
