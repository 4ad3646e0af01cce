# Which symbols a library exports. A plug-in or an extension shares its process with the libraries of an editor, which
# may have other versions of what it contains.
include_guard()

# usdlive_exports(target symbol...): the target exports these symbols and no others, not even those that C++ makes in
# several libraries (templates, type information). OpenUSD and the standard library compare types by their names.
function(usdlive_exports target)
    set(script ${CMAKE_CURRENT_BINARY_DIR}/${target}.exports)
    set(global)
    foreach(symbol ${ARGN})
        string(APPEND global "${symbol}; ")
    endforeach()
    if(global)
        set(global "global: ${global}")
    endif()
    file(CONFIGURE OUTPUT ${script} CONTENT "{ ${global}local: *; };\n")
    target_link_options(${target} PRIVATE LINKER:--version-script=${script})
    set_property(TARGET ${target} APPEND PROPERTY LINK_DEPENDS ${script})
endfunction()
