# malus_cuda_module(): src/malus/cuda by nvcc. Called by hand, because CMake 3.25 does not know the C++20 flag of newer
# CUDA. -fmad=false: no contraction, so that GPU and CPU give the same bits. Turing's code serves all that follow.
set(malus_cuda_flags -std=c++20 -O3 -fmad=false -I${PROJECT_SOURCE_DIR}/src)
function(malus_cuda_module)
  malus_module(cuda DEPENDS synthesize)
  include(${PROJECT_SOURCE_DIR}/src/malus/cuda/kernels.cmake)
  foreach(kernel IN LISTS cuda_KERNELS)
    set(object ${PROJECT_BINARY_DIR}/cuda/${kernel}.o)
    add_custom_command(OUTPUT ${object}
      COMMAND ${MALUS_NVCC} ${malus_cuda_flags} -Xcompiler -fPIC
              -gencode arch=compute_75,code=[sm_75,compute_75] -gencode arch=compute_90,code=sm_90
              -MD -MF ${object}.d -MT ${object}
              -c ${PROJECT_SOURCE_DIR}/src/malus/cuda/${kernel} -o ${object}
      DEPENDS ${PROJECT_SOURCE_DIR}/src/malus/cuda/${kernel} DEPFILE ${object}.d
      COMMENT "Building CUDA object ${kernel}.o" VERBATIM)
    target_sources(malus_cuda PRIVATE ${object})
  endforeach()
  file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/cuda)
  target_include_directories(malus_cuda SYSTEM PRIVATE ${MALUS_CUDA_TOOLKIT}/include)
  target_link_libraries(malus_cuda PRIVATE ${MALUS_CUDART} Threads::Threads ${CMAKE_DL_LIBS} rt)
endfunction()

# malus_find_cuda(): MALUS_NVCC, MALUS_CUDA_TOOLKIT and MALUS_CUDART, or MALUS_NVCC false where any is missing. The toolkit's
# folder is asked of nvcc itself: the nvcc on PATH may be a wrapper or a link that lies elsewhere.
function(malus_find_cuda)
  find_program(MALUS_NVCC nvcc PATHS /usr/local/cuda/bin)
  if(NOT MALUS_NVCC)
    return()
  endif()
  execute_process(COMMAND ${MALUS_NVCC} --dryrun -E -x cu /dev/null OUTPUT_VARIABLE said ERROR_VARIABLE said)
  string(REGEX MATCH "TOP=([^\n]+)" found "${said}")
  get_filename_component(toolkit "${CMAKE_MATCH_1}" REALPATH)
  find_library(MALUS_CUDART cudart_static NO_DEFAULT_PATH
               PATHS ${toolkit}/lib64 ${toolkit}/targets/x86_64-linux/lib ${toolkit}/lib $ENV{CUDA_HOME}/lib64)
  if(NOT found OR NOT MALUS_CUDART)
    message(STATUS "CUDA: ${MALUS_NVCC} is here, its toolkit is not complete (no cudart_static); built without")
    set(MALUS_NVCC MALUS_NVCC-NOTFOUND PARENT_SCOPE)
    return()
  endif()
  set(MALUS_CUDA_TOOLKIT ${toolkit} PARENT_SCOPE)
  message(STATUS "CUDA: ${MALUS_NVCC}, toolkit ${toolkit}")
endfunction()
