# malus_fuzz_targets(out): names of all fuzz/<name>_fuzz.cpp; sets <name>_LIBRARIES from the file's first line
# "// links: malus_io malus_noise".
macro(malus_fuzz_targets out)
  file(GLOB fuzz_sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/fuzz/*_fuzz.cpp)
  set(${out})
  foreach(source IN LISTS fuzz_sources)
    get_filename_component(name ${source} NAME_WE)
    string(REGEX REPLACE "_fuzz$" "" name ${name})
    file(STRINGS ${source} first_line LIMIT_COUNT 1)
    string(REGEX REPLACE "^// links: *" "" libraries "${first_line}")
    separate_arguments(${name}_LIBRARIES UNIX_COMMAND "${libraries}")
    # A parser of an optional module is left out where the module is.
    list(GET ${name}_LIBRARIES 0 library)
    if(TARGET ${library})
      list(APPEND ${out} ${name})
    endif()
  endforeach()
endmacro()
