# This file is sources/CMakeLists.txt of every FMU with sources. It compiles the FMU for the present
# machine with CMake and GCC or Clang (C, C++17). In the unpacked FMU:
#
#   cmake -S sources -B build && cmake --build build --target install --config Release
#
# The library is then in binaries/PLATFORM. FMPy does the same with buildDescription.xml.
cmake_minimum_required(VERSION 3.15)
project(dockloop LANGUAGES C CXX)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
file(STRINGS ${CMAKE_SOURCE_DIR}/buildDescription.xml name REGEX "modelIdentifier=")
string(REGEX REPLACE ".*modelIdentifier=\"([^\"]+)\".*" "\\1" name "${name}")

file(GLOB files *.cpp */*.cpp */*.c)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64)$")  # vector registers are chosen at run time
  add_compile_definitions(DOCKLOOP_X86_LANES)
  foreach(file ${files})
    if(file MATCHES "_avx2\\.cpp$")
      set_source_files_properties(${file} PROPERTIES COMPILE_OPTIONS -mavx2)
    elseif(file MATCHES "_avx512\\.cpp$")
      set_source_files_properties(${file} PROPERTIES
                                  COMPILE_OPTIONS "-mavx512f;-mavx512dq;-mavx512vl")
    endif()
  endforeach()
else()
  list(FILTER files EXCLUDE REGEX "_avx(2|512)\\.cpp$")
endif()
add_library(${name} SHARED ${files})
target_include_directories(${name} SYSTEM PRIVATE ${CMAKE_SOURCE_DIR})
set_target_properties(${name} PROPERTIES PREFIX "" CXX_STANDARD 17 CXX_STANDARD_REQUIRED ON
  C_VISIBILITY_PRESET hidden CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)
target_compile_options(${name} PRIVATE -fno-math-errno -ffp-contract=off)
if(UNIX AND NOT APPLE)
  target_link_libraries(${name} PRIVATE m ${CMAKE_DL_LIBS})
  target_link_options(${name} PRIVATE -Wl,--version-script=${CMAKE_SOURCE_DIR}/exports.map)
endif()

# Folder names of FMI 2.0; names of FMI 3.0 for platforms without a name in 2.0.
string(TOLOWER "${CMAKE_SYSTEM_PROCESSOR}" processor)
string(REPLACE "arm64" "aarch64" processor "${processor}")
set(system linux)
if(WIN32)
  set(system windows)
elseif(APPLE)
  set(system darwin)
endif()
if(processor MATCHES "^(x86_64|amd64|i[3-6]86|x86)$")
  math(EXPR bits "8 * ${CMAKE_SIZEOF_VOID_P}")
  string(REPLACE "windows" "win" platform "${system}${bits}")
else()
  set(platform ${processor}-${system})
endif()
set(folder ${CMAKE_SOURCE_DIR}/../binaries/${platform})
install(TARGETS ${name} RUNTIME DESTINATION ${folder} LIBRARY DESTINATION ${folder}
        ARCHIVE DESTINATION ${CMAKE_BINARY_DIR})
