# Debian's OpenImageIO names OpenCV's headers in its interface without needing them or depending on them: paths that are not
# there are taken out. Also installed, for users of the package.
get_target_property(malus_oiio_includes OpenImageIO::OpenImageIO INTERFACE_INCLUDE_DIRECTORIES)
set(malus_oiio_present)
foreach(folder IN LISTS malus_oiio_includes)
  if(EXISTS "${folder}")
    list(APPEND malus_oiio_present "${folder}")
  endif()
endforeach()
set_target_properties(OpenImageIO::OpenImageIO PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${malus_oiio_present}")
