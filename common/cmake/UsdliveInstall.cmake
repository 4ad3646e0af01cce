# The installation: the programs and the C++ client as a CMake package, with the OpenUSD of the build; and by its name
# the component `wheel`, the compiled part of the Python package. pyproject.toml names what is not compiled.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

# usdlive_install_into_wheel(target folder up): installs a target into a folder of the wheel. `up` is the path from there
# to the folder that usd-core is installed in, too.
function(usdlive_install_into_wheel target folder up)
    set(wheel COMPONENT wheel EXCLUDE_FROM_ALL)
    install(TARGETS ${target} RUNTIME DESTINATION ${folder} ${wheel} LIBRARY DESTINATION ${folder} ${wheel})
    # A target has one INSTALL_RPATH. It is that of the CMake package, if there is one.
    set(rpath "\\$ORIGIN/${up}/usd_core.libs")
    set_target_properties(${target} PROPERTIES INSTALL_RPATH "$ORIGIN/${up}/usd_core.libs")
    install(CODE "file(RPATH_SET FILE \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${folder}/$<TARGET_FILE_NAME:${target}>\"
        NEW_RPATH \"${rpath}\")" ${wheel})
endfunction()

function(usdlive_install_wheel)
    set(package ${PROJECT_BINARY_DIR}/python/usdlive)
    install(FILES ${package}/_built_for.py ${package}/_error_code.py ${package}/schemas.py
        DESTINATION usdlive COMPONENT wheel EXCLUDE_FROM_ALL)
    usdlive_install_into_wheel(_usdlive usdlive ..)
    install(TARGETS _session LIBRARY DESTINATION usdlive COMPONENT wheel EXCLUDE_FROM_ALL)
    usdlive_install_into_wheel(usdlive usdlive/bin ../..)
    usdlive_install_into_wheel(usdlive-server usdlive/bin ../..)
    get_property(plugins GLOBAL PROPERTY usdlive_plugins)
    install(DIRECTORY ${plugins}/ DESTINATION usdlive/_plugins COMPONENT wheel EXCLUDE_FROM_ALL PATTERN "*.so" EXCLUDE)
    get_property(libraries GLOBAL PROPERTY usdlive_plugin_libraries)
    foreach(library ${libraries})
        usdlive_install_into_wheel(${library} usdlive/_plugins/${library} ../../..)
    endforeach()
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

if(TARGET _usdlive AND TARGET usdlive-server AND NOT USDLIVE_OPENUSD_ROOT)
    usdlive_install_wheel()
endif()
if(NOT SKBUILD)
    if(NOT USDLIVE_OPENUSD_ROOT)
        include(InstallOpenUsd)
    endif()
    usdlive_install_package()
endif()
