# `cmake --install`: program, libraries, headers and a package for find_package(malus).
include(CMakePackageConfigHelpers)
get_property(modules GLOBAL PROPERTY MALUS_MODULES)
add_library(malus INTERFACE)
add_library(malus::malus ALIAS malus)
foreach(module IN LISTS modules)
  target_link_libraries(malus INTERFACE malus_${module})
  install(DIRECTORY src/malus/${module} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/malus
          FILES_MATCHING PATTERN "*.h" PATTERN "internal" EXCLUDE)
  install(TARGETS malus_${module} EXPORT malusTargets ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
endforeach()
install(TARGETS malus EXPORT malusTargets)
install(EXPORT malusTargets NAMESPACE malus:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/malus)
configure_package_config_file(cmake/malusConfig.cmake.in ${CMAKE_BINARY_DIR}/malusConfig.cmake
  INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/malus)
write_basic_package_version_file(${CMAKE_BINARY_DIR}/malusConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/malusConfig.cmake cmake/MalusOpenImageIO.cmake ${CMAKE_BINARY_DIR}/malusConfigVersion.cmake
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/malus)
