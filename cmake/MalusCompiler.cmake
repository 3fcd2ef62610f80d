# Language level and warnings; for malus by itself also ccache and the build type that a bare `cmake` gets.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
if(PROJECT_IS_TOP_LEVEL)
  set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
  if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
    set(CMAKE_BUILD_TYPE Release)
  endif()
  find_program(MALUS_CCACHE ccache)
  if(MALUS_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
    set(CMAKE_CXX_COMPILER_LAUNCHER ${MALUS_CCACHE})
  endif()
endif()

add_library(malus_warnings INTERFACE)
target_compile_options(malus_warnings INTERFACE -Wall -Wextra -Wconversion -Wshadow
                       $<$<BOOL:${MALUS_WERROR}>:-Werror>)
if(MALUS_TIDY)
  find_program(MALUS_CLANG_TIDY clang-tidy REQUIRED)
  set(CMAKE_CXX_CLANG_TIDY ${MALUS_CLANG_TIDY})
endif()
# Contraction to FMA would make results differ between machines and between scalar and SIMD code.
add_compile_options(-ffp-contract=off)

# What reads options or tests, while the work lies in the modules: a third less time to compile than with -O3.
function(malus_compile_quickly target)
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1 -finline-small-functions>)
endfunction()

# The GPU twin, where nvcc is.
option(MALUS_CUDA "Build the GPU twin of the sampler where nvcc is found" ON)
if(MALUS_CUDA)
  include(MalusCuda)
  malus_find_cuda()
endif()
