# SPDX-License-Identifier: BSD-3-Clause
# How interface packages are built on the ROS 2 wheels: all of them alike, and without a line in their own CMakeLists.txt.
# Given as CMAKE_PROJECT_INCLUDE. With ROS installed nothing of this is used: everything is generated the ordinary way.
include_guard(DIRECTORY)

# Copied, which CMake does at once; for symbolic links ament starts a program for each file. Said before any package is
# found, since ament_cmake decides then.
set(AMENT_CMAKE_SYMLINK_INSTALL OFF)

# For Python alone: not the C++ interfaces, which nothing here uses, and which take most of the time of a compiler.
# What the package finds a second time stays as it is now.
find_package(rosidl_default_generators QUIET)
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")

# The wheels have no C++ client library. Packages of states and behaviors for FlexBE ask for it and use nothing of it:
# they find a package that is empty.
find_package(rclcpp QUIET)
if(NOT rclcpp_FOUND)
  file(WRITE "${CMAKE_BINARY_DIR}/empty_packages/rclcppConfig.cmake"
    "message(STATUS \"The ROS 2 wheels have no rclcpp: code that includes it can be built with ROS 2 sourced only\")\n")
  set(rclcpp_DIR "${CMAKE_BINARY_DIR}/empty_packages" CACHE PATH "Stands in for rclcpp" FORCE)
endif()

# Several generated files are compiled as one: what takes the time is the headers that all of them include.
# Not the *__description.c, which define constants of the same names.
function(_compile_together)
  get_property(targets DIRECTORY PROPERTY BUILDSYSTEM_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(type ${target} TYPE)
    if(type MATCHES "_LIBRARY$")
      set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 24)
      get_target_property(sources ${target} SOURCES)
      list(FILTER sources INCLUDE REGEX "__description\\.c$")
      if(sources)
        set_source_files_properties(${sources} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
      endif()
    endif()
  endforeach()
endfunction()

# The wheels' exported *__rosidl_generator_py targets carry the include directories of the machine that built the wheels
# (/opt/python/cp3XX-cp3XX/...). They are replaced in the imported targets; no installed file is touched.
function(_replace_include_directories)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(directories MATCHES "/opt/python/cp")
      list(FILTER directories EXCLUDE REGEX "^/opt/python/cp")
      list(APPEND directories ${Python3_INCLUDE_DIRS} ${Python3_NumPy_INCLUDE_DIRS})
      list(REMOVE_DUPLICATES directories)
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${directories}")
    endif()
  endforeach()
endfunction()

# When all of the package's CMakeLists.txt is done, and nothing is generated yet.
cmake_language(DEFER CALL _compile_together)
cmake_language(DEFER CALL _replace_include_directories)
