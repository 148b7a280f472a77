# For building on the ROS wheels (setup/messages.cmake and `make colcon`).
# Their CMake targets carry the include paths of the machine they were made on, which CMake
# refuses as "non-existent path". Drop those paths once the project's targets are known.
function(drop_missing_include_directories)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT directories)
      continue()
    endif()
    set(kept "")
    foreach(directory IN LISTS directories)
      # Generator expressions ($<...>) are no absolute paths: they stay.
      if(NOT IS_ABSOLUTE "${directory}" OR EXISTS "${directory}")
        list(APPEND kept "${directory}")
      endif()
    endforeach()
    set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${kept}")
  endforeach()
endfunction()
cmake_language(DEFER CALL drop_missing_include_directories)

# The compiler reads the headers of these once for all files.
function(compile_together)
  foreach(of generator_py typesupport_c typesupport_cpp typesupport_fastrtps_c typesupport_fastrtps_cpp
      typesupport_introspection_c)
    if(TARGET ${PROJECT_NAME}__rosidl_${of})
      set_target_properties(${PROJECT_NAME}__rosidl_${of}
        PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 0)
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL compile_together)
