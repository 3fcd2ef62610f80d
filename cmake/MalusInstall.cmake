# malus::malus, all modules but the optional ones, for who includes malus' source tree too; and, with MALUS_INSTALL,
# `cmake --install`: program, man pages, shell completion, libraries, headers, Python module and a CMake package:
# find_package(malus) gives malus::malus; the optional modules are components: find_package(malus COMPONENTS neural) gives
# malus::neural. Components for CPack: program, networks, development, python.
set(malus_optional_modules capture neural cuda)
get_property(modules GLOBAL PROPERTY MALUS_MODULES)
add_library(malus INTERFACE)
add_library(malus::malus ALIAS malus)
foreach(module IN LISTS modules)
  if(NOT module IN_LIST malus_optional_modules)
    target_link_libraries(malus INTERFACE malus_${module})
  endif()
endforeach()
if(NOT MALUS_INSTALL)
  return()
endif()

include(CMakePackageConfigHelpers)
set(malus_package ${CMAKE_INSTALL_LIBDIR}/cmake/malus)
set(CMAKE_INSTALL_DEFAULT_COMPONENT_NAME development)
foreach(module IN LISTS modules)
  install(DIRECTORY src/malus/${module} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/malus
          FILES_MATCHING PATTERN "*.h" PATTERN "internal" EXCLUDE)
  if(module IN_LIST malus_optional_modules)
    set(export malus_${module}_targets)
    install(EXPORT ${export} NAMESPACE malus:: FILE malus-${module}.cmake DESTINATION ${malus_package})
  else()
    set(export malus_targets)
  endif()
  install(TARGETS malus_${module} EXPORT ${export} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
endforeach()
install(FILES src/malus/malus.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/malus)
install(TARGETS malus EXPORT malus_targets)
install(EXPORT malus_targets NAMESPACE malus:: FILE malusTargets.cmake DESTINATION ${malus_package})
configure_package_config_file(cmake/malusConfig.cmake.in ${PROJECT_BINARY_DIR}/malusConfig.cmake
  INSTALL_DESTINATION ${malus_package})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/malusConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/malusConfig.cmake ${PROJECT_BINARY_DIR}/malusConfigVersion.cmake
        DESTINATION ${malus_package})

# Man pages and completion are written by the program itself, from the declarations of its commands.
set(malus_manual ${PROJECT_BINARY_DIR}/manual)
add_custom_command(OUTPUT ${malus_manual}/written
  COMMAND ${CMAKE_COMMAND} -E rm -rf ${malus_manual}
  COMMAND malus_program manual --quiet -o ${malus_manual} > ${PROJECT_BINARY_DIR}/manual.txt
  COMMAND ${CMAKE_COMMAND} -E touch ${malus_manual}/written
  DEPENDS malus_program COMMENT "Writing man pages and shell completion" VERBATIM)
add_custom_target(malus_manual ALL DEPENDS ${malus_manual}/written)
install(DIRECTORY ${malus_manual}/ DESTINATION ${CMAKE_INSTALL_DATADIR} COMPONENT program PATTERN written EXCLUDE)

# Debian packages: cpack -G DEB. What the programs need is read from the libraries that they are linked to.
set(CPACK_PACKAGE_CONTACT "malus developers <malus@users.noreply.github.com>")
set(CPACK_PACKAGE_VENDOR "malus")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_RESOURCE_FILE_LICENSE ${PROJECT_SOURCE_DIR}/LICENSE)
set(CPACK_STRIP_FILES ON)
set(CPACK_GENERATOR DEB)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_COMPONENTS_ALL program development)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME malus)
set(CPACK_DEBIAN_PROGRAM_DESCRIPTION "measure, imitate and remove camera noise")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libmalus-dev)
set(CPACK_DEBIAN_DEVELOPMENT_DESCRIPTION "measure, imitate and remove camera noise: C++ library")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS
    "g++, cmake, pkg-config, libtbb-dev, libfmt-dev, libeigen3-dev, libhwy-dev, libtiff-dev, libpng-dev, libopenexr-dev, libimath-dev, libturbojpeg0-dev, libraw-dev, libhdf5-dev, zlib1g-dev, libtomlplusplus-dev, nlohmann-json3-dev")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SUGGESTS "libaravis-dev, libtorch-dev")
if(TARGET malus_networks)
  list(APPEND CPACK_COMPONENTS_ALL networks)
  set(CPACK_DEBIAN_NETWORKS_PACKAGE_NAME malus-networks)
  set(CPACK_DEBIAN_NETWORKS_PACKAGE_DEPENDS "malus (= ${PROJECT_VERSION})")
  set(CPACK_DEBIAN_NETWORKS_PACKAGE_RECOMMENDS libopenblas0-openmp)
  set(CPACK_DEBIAN_NETWORKS_DESCRIPTION "measure, imitate and remove camera noise: networks")
  set(CPACK_DEBIAN_PROGRAM_PACKAGE_SUGGESTS malus-networks)
endif()
if(TARGET malus_python)
  list(APPEND CPACK_COMPONENTS_ALL python)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-malus)
  set(CPACK_DEBIAN_PYTHON_DESCRIPTION "measure, imitate and remove camera noise: Python module")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
  execute_process(COMMAND ${PYTHON_EXECUTABLE} -c "import sys; v = sys.version_info; print(f'python3 (>= 3.{v.minor}), python3 (<< 3.{v.minor + 1})')"
                  OUTPUT_VARIABLE malus_python_versions OUTPUT_STRIP_TRAILING_WHITESPACE)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "${malus_python_versions}, python3-numpy")
  if(TARGET malus_networks)
    set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS malus-networks)
  endif()
endif()
include(CPack)
