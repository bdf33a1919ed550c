# CMake toolchain for other platforms and older systems: the clang of the Python package ziglang,
# which brings C and C++ runtimes for every target and links them in. DOCKLOOP_TARGET names the
# target as zig does: processor-system-runtime, for example x86_64-linux-gnu.2.17 (glibc 2.17).
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES DOCKLOOP_TARGET)
string(REGEX MATCH "^([^-]+)-([a-z]+)" found "${DOCKLOOP_TARGET}")
set(CMAKE_SYSTEM_PROCESSOR ${CMAKE_MATCH_1})
set(system_linux Linux)
set(system_windows Windows)
set(system_macos Darwin)
set(CMAKE_SYSTEM_NAME ${system_${CMAKE_MATCH_2}})

file(GLOB zig ${CMAKE_CURRENT_LIST_DIR}/../../.venv/lib/python3*/site-packages/ziglang/zig)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)  # linking takes a C++ runtime
set(CMAKE_C_COMPILER ${zig} cc)
set(CMAKE_CXX_COMPILER ${zig} c++)
foreach(language C CXX)
  set(CMAKE_${language}_COMPILER_TARGET ${DOCKLOOP_TARGET})
  set(CMAKE_${language}_ARCHIVE_CREATE "${zig} ar qc <TARGET> <OBJECTS>")
  set(CMAKE_${language}_ARCHIVE_APPEND "${zig} ar q <TARGET> <OBJECTS>")
  set(CMAKE_${language}_ARCHIVE_FINISH "${zig} ranlib <TARGET>")
endforeach()
set(CMAKE_INSTALL_NAME_TOOL ${zig})  # asked for by CMake for macOS, used by nothing here
