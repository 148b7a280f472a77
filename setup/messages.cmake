# For messages that only Python uses, on the ROS wheels (CMAKE_PROJECT_INCLUDE of
# setup/messages.sh): a third of the processor time of a whole build.
include(${CMAKE_CURRENT_LIST_DIR}/wheels.cmake)

# Nothing for C++. A package of ROS that was found is not looked for again, so that the project's
# own find_package changes nothing. (rmw_fastrtps_cpp needs the introspection in C.)
find_package(rosidl_default_generators REQUIRED)
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")

# The compiler reads the headers of these once for several files.
function(compile_together)
  foreach(of generator_py typesupport_c typesupport_fastrtps_c typesupport_introspection_c)
    if(TARGET ${PROJECT_NAME}__rosidl_${of})
      set_target_properties(${PROJECT_NAME}__rosidl_${of}
        PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 6)
    endif()
  endforeach()
endfunction()
cmake_language(DEFER CALL compile_together)
