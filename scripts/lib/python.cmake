# The Python of another platform, for the module of a wheel: headers and, for Windows, python3.lib, in
# DOCKLOOP_PYTHON_ROOT (setup.sh fetches them). They are of 3.12, the first version whose stable ABI
# nanobind can use: one module serves this version and all later ones.
#
# find_package(Python) would have to run the other Python. These are the targets and variables of
# find_package(Python) that nanobind uses.
add_executable(Python::Interpreter IMPORTED)
add_library(Python::Module INTERFACE IMPORTED)
add_library(Python::SABIModule INTERFACE IMPORTED)
if(WIN32)
  target_link_libraries(Python::SABIModule INTERFACE ${DOCKLOOP_PYTHON_ROOT}/libs/python3.lib)
  set(Python_SOSABI "")
else()
  set(Python_SOSABI abi3)
endif()
set(Python_SOABI cpython-312-${CMAKE_SYSTEM_NAME})  # of no use with the stable ABI
set(Python_VERSION 3.12)
set(Python_INTERPRETER_ID Python)
set(Python_INCLUDE_DIRS ${DOCKLOOP_PYTHON_ROOT}/include)

function(fit_module_to_zig module)
  # nanobind prints to stderr; Python.h includes <stdio.h> only without the stable ABI.
  target_compile_options(nanobind-static-abi3 PUBLIC "SHELL:-include cstdio")
  if(CMAKE_SYSTEM_NAME STREQUAL Linux)
    target_link_options(${module} PRIVATE -Wl,--version-script=${CMAKE_SOURCE_DIR}/fmu/exports.map)
  elseif(APPLE)
    # The linker of zig cannot make a bundle, nor read the list of Python's symbols that nanobind
    # passes. Python also loads a library, and tests/test_wheels.py checks the symbols.
    set(CMAKE_SHARED_MODULE_CREATE_CXX_FLAGS -shared PARENT_SCOPE)
    set_target_properties(${module} PROPERTIES LINK_OPTIONS -Wl,-undefined,dynamic_lookup)
  endif()
endfunction()
