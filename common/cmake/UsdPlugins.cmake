# Functions that build plug-ins of OpenUSD. Also installed with usdlive's package, so that a folder of
# plugins/ that was copied to another project builds there (docs/plugins.md).
include_guard()

# Every plug-in gets its own folder below this one. PXR_PLUGINPATH_NAME may name this folder, for all of
# them, or the folder of one.
set(USDLIVE_PLUGINS ${PROJECT_BINARY_DIR}/plugins)
file(CONFIGURE OUTPUT ${USDLIVE_PLUGINS}/plugInfo.json CONTENT "{\"Includes\": [\"*/plugInfo.json\"]}\n")
if(NOT TARGET plugins)
    add_custom_target(plugins ALL)
endif()

# usdlive_usd_plugin(name SOURCES file... [LINK library...]): builds a plug-in with a library, from sources and
# the plugInfo.json of the current folder. The library needs no other of ours and exports no symbols.
function(usdlive_usd_plugin name)
    cmake_parse_arguments(ARG "" "" "SOURCES;LINK" ${ARGN})
    add_library(${name} MODULE ${ARG_SOURCES})
    target_compile_options(${name} PRIVATE ${USDLIVE_WARNINGS})
    target_compile_definitions(${name} PRIVATE MFB_PACKAGE_NAME=${name} MFB_ALT_PACKAGE_NAME=${name})
    target_link_libraries(${name} PRIVATE usdlive::openusd ${ARG_LINK})
    set_target_properties(${name} PROPERTIES
        PREFIX "" UNITY_BUILD OFF CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON
        LIBRARY_OUTPUT_DIRECTORY ${USDLIVE_PLUGINS}/${name})
    configure_file(plugInfo.json ${USDLIVE_PLUGINS}/${name}/plugInfo.json COPYONLY)
    add_dependencies(plugins ${name})
endfunction()
