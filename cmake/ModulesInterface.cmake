# The program and its module of networks share objects whose layout the headers give: all are stamped with a digest of all headers, and the
# program refuses a module with another one (built before a header changed, say by ./quickstart, and left behind by
# ./quickstart --no-networks).
# Included: target malus_modules_interface, which makes malus_modules_interface.h. As a script (-P): makes it.
if(CMAKE_SCRIPT_MODE_FILE)
  set(digests)
  foreach(header IN LISTS HEADERS)
    file(SHA256 ${header} digest)
    string(APPEND digests ${digest})
  endforeach()
  string(SHA256 digest "${digests}")
  string(SUBSTRING ${digest} 0 16 digest)
  file(WRITE ${OUTPUT} "// Made by cmake/ModulesInterface.cmake.\n#pragma once\n\n#include <cstdint>\n\n"
       "namespace malus::app {\n/// Digest of the headers that the program and its modules were built from.\n"
       "inline constexpr std::uint64_t kModulesInterface = 0x${digest};\n}  // namespace malus::app\n")
  return()
endif()

set(folder ${PROJECT_BINARY_DIR}/generated)
file(GLOB_RECURSE headers CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/src/malus/*.h)
list(APPEND headers ${PROJECT_SOURCE_DIR}/apps/networks/networks.h)
add_custom_command(OUTPUT ${folder}/malus_modules_interface.h
  COMMAND ${CMAKE_COMMAND} "-DHEADERS=${headers}" -DOUTPUT=${folder}/malus_modules_interface.h -P ${CMAKE_CURRENT_LIST_FILE}
  DEPENDS ${headers} ${CMAKE_CURRENT_LIST_FILE} COMMENT "Digest of the headers" VERBATIM)
add_custom_target(malus_modules_interface DEPENDS ${folder}/malus_modules_interface.h)
# Both sides of the door.
function(malus_stamp_interface target)
  add_dependencies(${target} malus_modules_interface)
  target_include_directories(${target} PRIVATE ${PROJECT_BINARY_DIR}/generated)
endfunction()
