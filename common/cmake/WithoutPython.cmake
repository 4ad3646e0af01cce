# Programs that run no Python. The library of usd-core refers to Python's API, because it is made for Python. A program
# with it needs definitions of these names, although OpenUSD calls hardly any of them while Py_IsInitialized() returns 0.
# With definitions of our own, a program needs no libpython, which many installations of Python do not have.
include_guard()

# usdlive_without_python(target...): the executables get the definitions instead of libpython.
function(usdlive_without_python)
    if(USDLIVE_OPENUSD_ROOT)
        return()
    endif()
    set(source ${PROJECT_BINARY_DIR}/WithoutPython.c)
    if(NOT TARGET usdlive_without_python)
        usdlive_python_names(${source})
        add_library(usdlive_without_python OBJECT ${source})
    endif()
    foreach(target ${ARGN})
        set_target_properties(${target} PROPERTIES USDLIVE_WITHOUT_PYTHON ON)
        target_sources(${target} PRIVATE $<TARGET_OBJECTS:usdlive_without_python>)
    endforeach()
endfunction()

# usdlive_python_names(source): writes the definitions of all of Python's names that OpenUSD's library needs.
function(usdlive_python_names source)
    execute_process(COMMAND ${CMAKE_NM} -D --undefined-only --format=just-symbols ${USDLIVE_USD_LIBRARY}
        OUTPUT_VARIABLE needed COMMAND_ERROR_IS_FATAL ANY)
    string(REGEX MATCHALL "(^|\n)_?Py[A-Za-z0-9_]+" needed "${needed}")
    set(definitions)
    foreach(name ${needed})
        string(STRIP ${name} name)
        if(name MATCHES "^(Py_IsInitialized|PyGILState_Check)$")
            continue()
        elseif(name MATCHES "^PyExc_")
            set(kind EXCEPTION)
        elseif(name MATCHES "(_Type|Struct)$" AND NOT name STREQUAL "PyObject_Type")
            set(kind OBJECT)
        else()
            set(kind FUNCTION)
        endif()
        string(APPEND definitions "${kind}(${name})\n")
    endforeach()
    configure_file(${CMAKE_CURRENT_FUNCTION_LIST_DIR}/WithoutPython.c.in ${source} @ONLY)
endfunction()
