# Functions that build plug-ins of OpenUSD. With OpenUsd.cmake they also work in other projects, so that a
# folder of plugins/ can be copied as the start of one (docs/plugins.md).
include_guard()
include(${CMAKE_CURRENT_LIST_DIR}/UsdliveExports.cmake)

# Every plug-in gets its own folder below this one. PXR_PLUGINPATH_NAME may name this folder, for all of
# them, or the folder of one.
set(USDLIVE_PLUGINS ${PROJECT_BINARY_DIR}/usd-plugins)
set_property(GLOBAL PROPERTY usdlive_plugins ${USDLIVE_PLUGINS})
file(CONFIGURE OUTPUT ${USDLIVE_PLUGINS}/plugInfo.json CONTENT "{\"Includes\": [\"*/plugInfo.json\"]}\n")
if(NOT TARGET plugins)
    add_custom_target(plugins ALL)
endif()

# usdlive_usd_plugin(name SOURCES file... [LINK library...] [EXPORTS symbol...]): builds a plug-in with a library, from
# sources and the plugInfo.json of the current folder. Libraries of ours are linked statically. OpenUSD needs no symbol of
# a plug-in, so that it exports only those for other callers.
function(usdlive_usd_plugin name)
    cmake_parse_arguments(ARG "" "" "SOURCES;LINK;EXPORTS" ${ARGN})
    add_library(${name} MODULE ${ARG_SOURCES})
    target_compile_options(${name} PRIVATE ${USDLIVE_WARNINGS})
    target_compile_definitions(${name} PRIVATE MFB_PACKAGE_NAME=${name} MFB_ALT_PACKAGE_NAME=${name})
    target_link_libraries(${name} PRIVATE usdlive::openusd ${ARG_LINK})
    usdlive_exports(${name} ${ARG_EXPORTS})
    set_target_properties(${name} PROPERTIES
        PREFIX "" CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON
        LIBRARY_OUTPUT_DIRECTORY ${USDLIVE_PLUGINS}/${name})
    configure_file(plugInfo.json ${USDLIVE_PLUGINS}/${name}/plugInfo.json COPYONLY)
    add_dependencies(plugins ${name})
    set_property(GLOBAL APPEND PROPERTY usdlive_plugin_libraries ${name})
endfunction()

# usdlive_install_usd_plugins(folder rpath [COMPONENT component]): installs all plug-ins below the folder. `rpath` is
# the path from a plug-in to the libraries of OpenUSD; empty: the one of the build.
function(usdlive_install_usd_plugins folder rpath)
    # The caller is in another folder of the tree, which has no variables of this one.
    get_property(plugins GLOBAL PROPERTY usdlive_plugins)
    if(NOT plugins)
        message(FATAL_ERROR "There are no plug-ins to install.")
    endif()
    install(DIRECTORY ${plugins}/ DESTINATION ${folder} ${ARGN} PATTERN "*.so" EXCLUDE)
    get_property(libraries GLOBAL PROPERTY usdlive_plugin_libraries)
    foreach(library ${libraries})
        if(rpath)
            set_target_properties(${library} PROPERTIES INSTALL_RPATH "$ORIGIN/${rpath}")
        else()
            set_target_properties(${library} PROPERTIES INSTALL_RPATH_USE_LINK_PATH ON)
        endif()
        install(TARGETS ${library} LIBRARY DESTINATION ${folder}/${library} ${ARGN})
    endforeach()
endfunction()

set(USDLIVE_SCHEMA_TOOLS ${CMAKE_CURRENT_LIST_DIR}/../../plugins/schemaTools)

# usdGenSchema needs Jinja2. A Python without it gets it in the build folder.
set(USDLIVE_SCHEMA_ENVIRONMENT)
execute_process(COMMAND ${Python_EXECUTABLE} -c "import jinja2" RESULT_VARIABLE status ERROR_QUIET)
if(NOT status EQUAL 0)
    set(packages ${PROJECT_BINARY_DIR}/schema-packages)
    if(NOT EXISTS ${packages}/jinja2)
        message(STATUS "Installing Jinja2 in ${packages}")
        execute_process(COMMAND ${Python_EXECUTABLE} -m pip install --quiet --no-input
            --disable-pip-version-check --no-deps --target ${packages} Jinja2==3.1.6 MarkupSafe==3.0.4
            COMMAND_ERROR_IS_FATAL ANY)
    endif()
    set(USDLIVE_SCHEMA_ENVIRONMENT PYTHONPATH=${packages})
endif()

# usdlive_usd_schema(name [CPP header] [PYTHON module]): makes a schema library from the schema.usda of the current
# folder, and with CPP and PYTHON the classes that read and write its schemas.
function(usdlive_usd_schema name)
    cmake_parse_arguments(ARG "" "CPP;PYTHON" "" ${ARGN})
    set(folder ${USDLIVE_PLUGINS}/${name})
    set(outputs ${folder}/plugInfo.json ${folder}/generatedSchema.usda)
    set(options)
    if(ARG_CPP)
        list(APPEND options --cpp ${ARG_CPP})
        list(APPEND outputs ${ARG_CPP})
    endif()
    if(ARG_PYTHON)
        list(APPEND options --python ${ARG_PYTHON})
        list(APPEND outputs ${ARG_PYTHON})
    endif()
    set(generate ${USDLIVE_SCHEMA_TOOLS}/generateSchema.py)
    file(GLOB templates CONFIGURE_DEPENDS ${USDLIVE_SCHEMA_TOOLS}/*.jinja)
    # The generator keeps files that stay the same, so their times say nothing about whether it ran.
    set(stamp ${CMAKE_CURRENT_BINARY_DIR}/${name}.stamp)
    add_custom_command(
        OUTPUT ${stamp} BYPRODUCTS ${outputs}
        COMMAND ${CMAKE_COMMAND} -E env --unset=PXR_PLUGINPATH_NAME ${USDLIVE_SCHEMA_ENVIRONMENT}
            ${Python_EXECUTABLE} ${generate} schema.usda ${folder} ${options}
        COMMAND ${CMAKE_COMMAND} -E touch ${stamp}
        DEPENDS schema.usda ${generate} ${templates}
        WORKING_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR}
        VERBATIM)
    add_custom_target(${name} DEPENDS ${stamp})
    add_dependencies(plugins ${name})
endfunction()
