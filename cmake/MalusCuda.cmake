# malus_cuda_module(): src/malus/cuda by nvcc. Called by hand, because CMake 3.25 does not know the C++20 flag of newer
# CUDA. -fmad=false: no contraction, so that GPU and CPU give the same bits. Turing's code serves all that follow.
function(malus_cuda_module)
  malus_module(cuda DEPENDS synthesize)
  include(${CMAKE_SOURCE_DIR}/src/malus/cuda/kernels.cmake)
  foreach(kernel IN LISTS cuda_KERNELS)
    set(object ${CMAKE_BINARY_DIR}/cuda/${kernel}.o)
    add_custom_command(OUTPUT ${object}
      COMMAND ${MALUS_NVCC} -std=c++20 -O3 -fmad=false -Xcompiler -fPIC
              -gencode arch=compute_75,code=[sm_75,compute_75] -gencode arch=compute_90,code=sm_90
              -I${CMAKE_SOURCE_DIR}/src -MD -MF ${object}.d -MT ${object}
              -c ${CMAKE_SOURCE_DIR}/src/malus/cuda/${kernel} -o ${object}
      DEPENDS ${CMAKE_SOURCE_DIR}/src/malus/cuda/${kernel} DEPFILE ${object}.d
      COMMENT "Building CUDA object ${kernel}.o" VERBATIM)
    target_sources(malus_cuda PRIVATE ${object})
  endforeach()
  file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/cuda)
  get_filename_component(toolkit ${MALUS_NVCC} DIRECTORY)
  find_library(MALUS_CUDART cudart_static PATHS ${toolkit}/../lib64 ${toolkit}/../targets/x86_64-linux/lib REQUIRED)
  target_include_directories(malus_cuda SYSTEM PRIVATE ${toolkit}/../include)
  target_link_libraries(malus_cuda PRIVATE ${MALUS_CUDART} Threads::Threads ${CMAKE_DL_LIBS} rt)
endfunction()
