# `cmake --install`: program, libraries, headers and a package: find_package(malus) gives malus::malus; the optional modules
# are components: find_package(malus COMPONENTS neural) gives malus::neural.
include(CMakePackageConfigHelpers)
set(malus_package ${CMAKE_INSTALL_LIBDIR}/cmake/malus)
set(malus_optional_modules capture neural)
get_property(modules GLOBAL PROPERTY MALUS_MODULES)
add_library(malus INTERFACE)
add_library(malus::malus ALIAS malus)
foreach(module IN LISTS modules)
  install(DIRECTORY src/malus/${module} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/malus
          FILES_MATCHING PATTERN "*.h" PATTERN "internal" EXCLUDE)
  if(module IN_LIST malus_optional_modules)
    set(export malus_${module}_targets)
    install(EXPORT ${export} NAMESPACE malus:: FILE malus-${module}.cmake DESTINATION ${malus_package})
  else()
    set(export malus_targets)
    target_link_libraries(malus INTERFACE malus_${module})
  endif()
  install(TARGETS malus_${module} EXPORT ${export} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
endforeach()
install(FILES src/malus/malus.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/malus)
install(TARGETS malus EXPORT malus_targets)
install(EXPORT malus_targets NAMESPACE malus:: FILE malusTargets.cmake DESTINATION ${malus_package})
configure_package_config_file(cmake/malusConfig.cmake.in ${CMAKE_BINARY_DIR}/malusConfig.cmake
  INSTALL_DESTINATION ${malus_package})
write_basic_package_version_file(${CMAKE_BINARY_DIR}/malusConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_BINARY_DIR}/malusConfig.cmake ${CMAKE_BINARY_DIR}/malusConfigVersion.cmake cmake/MalusOpenImageIO.cmake
        DESTINATION ${malus_package})

# A Debian package: cpack -G DEB. What it needs is read from the linked libraries.
set(CPACK_PACKAGE_CONTACT "malus developers <malus@users.noreply.github.com>")
set(CPACK_PACKAGE_VENDOR "malus")
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_RESOURCE_FILE_LICENSE ${CMAKE_SOURCE_DIR}/LICENSE)
set(CPACK_GENERATOR DEB)
include(CPack)
