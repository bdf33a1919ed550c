# Collects the sources of the outside packages in one folder that is an include root by itself:
# Eigen/, nlohmann/, cvode/, nvector/, sundials/, ... with headers and .c files side by side.
# Portable binaries are compiled from it, and every FMU takes it along in sources/.
#
#   cmake -DARCHIVE=sundials.orig.tar.xz -DTARGET=FOLDER -P scripts/lib/sources.cmake
cmake_minimum_required(VERSION 3.25)
file(REMOVE_RECURSE ${TARGET} ${TARGET}.unpacked)

# Eigen: the modules the core uses and those they use.
set(eigen /usr/include/eigen3/Eigen)
foreach(module Core Cholesky Eigenvalues Geometry Householder Jacobi LU QR SVD)
  file(COPY ${eigen}/${module} DESTINATION ${TARGET}/Eigen)
  file(COPY ${eigen}/src/${module} DESTINATION ${TARGET}/Eigen/src)
endforeach()
file(COPY ${eigen}/src/misc ${eigen}/src/plugins DESTINATION ${TARGET}/Eigen/src)
foreach(unused AltiVec GPU HIP MSA SVE SYCL ZVector)  # processors without a platform here
  file(REMOVE_RECURSE ${TARGET}/Eigen/src/Core/arch/${unused})
endforeach()

file(COPY /usr/include/nlohmann DESTINATION ${TARGET})

# SUNDIALS: CVODE with serial vectors, dense and band matrices and solvers. IDA is for comparison
# only, which needs the installed packages. What its own build would find out about the
# compiler holds for every compiler of C99 and is written down here.
file(ARCHIVE_EXTRACT INPUT ${ARCHIVE} DESTINATION ${TARGET}.unpacked)
file(GLOB sundials ${TARGET}.unpacked/*)
foreach(part cvode nvector/serial sundials sunmatrix/dense sunmatrix/band sunlinsol/dense sunlinsol/band
        sunnonlinsol/newton)
  string(REGEX REPLACE "/.*" "" folder ${part})
  string(REPLACE "/" "_" header ${part})
  set(from ${sundials}/src/${part})
  file(GLOB files ${from}/*.c ${from}/*.h ${from}/*.def ${sundials}/include/${folder}/${header}*.h*)
  list(FILTER files EXCLUDE REGEX
    "_(cuda|hip|hypamgpre|sycl|profiler|xbraid|futils|lapack)|/f[a-z]*_")
  foreach(file ${files})  # private headers are found from the root, too
    file(READ ${file} text)
    string(REPLACE "#include \"sundials_" "#include \"sundials/sundials_" text "${text}")
    get_filename_component(name ${file} NAME)
    file(WRITE ${TARGET}/${folder}/${name} "${text}")
  endforeach()
endforeach()
file(COPY ${sundials}/include/sundials/sundials_profiler.h DESTINATION ${TARGET}/sundials)
file(COPY ${sundials}/include/sunmatrix/sunmatrix_sparse.h DESTINATION ${TARGET}/sunmatrix)

file(STRINGS ${sundials}/CMakeLists.txt lines REGEX "set\\(PACKAGE_VERSION_(MAJOR|MINOR|PATCH)")
foreach(line ${lines})
  string(REGEX MATCH "(PACKAGE_VERSION_[A-Z]+) *\"([0-9]+)\"" found ${line})
  set(${CMAKE_MATCH_1} ${CMAKE_MATCH_2})
endforeach()
set(PACKAGE_VERSION ${PACKAGE_VERSION_MAJOR}.${PACKAGE_VERSION_MINOR}.${PACKAGE_VERSION_PATCH})
set(SUNDIALS_DEPRECATED_MSG_MACRO "")
set(SUNDIALS_C_COMPILER_HAS_MATH_PRECISIONS ON)
set(SUNDIALS_C_COMPILER_HAS_ISINF_ISNAN ON)
set(SUNDIALS_C_COMPILER_HAS_INLINE ON)
set(SUNDIALS_C_COMPILER_HAS_SNPRINTF_AND_VA_COPY ON)
set(PRECISION_LEVEL "#define SUNDIALS_DOUBLE_PRECISION 1")
set(INDEX_TYPE "#define SUNDIALS_INT64_T 1")
set(SUNDIALS_CINDEX_TYPE int64_t)
set(SUNDIALS_LOGGING_LEVEL 0)
configure_file(${sundials}/include/sundials/sundials_config.in ${TARGET}/sundials/sundials_config.h)
file(WRITE ${TARGET}/sundials/sundials_export.h
  "/* Static and hidden: nothing of SUNDIALS is seen outside the library it is linked into. */\n"
  "#define SUNDIALS_EXPORT\n#define SUNDIALS_NO_EXPORT\n#define SUNDIALS_DEPRECATED\n"
  "#define SUNDIALS_DEPRECATED_EXPORT\n#define SUNDIALS_DEPRECATED_NO_EXPORT\n")

file(REMOVE_RECURSE ${TARGET}.unpacked)
