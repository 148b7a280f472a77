# For messages that only Python uses, on the ROS wheels (CMAKE_PROJECT_INCLUDE of
# setup/messages.sh): in much less processor time than a whole build.
include(${CMAKE_CURRENT_LIST_DIR}/wheels.cmake)

# Nothing for C++. A package of ROS that was found is not looked for again, so that the project's
# own find_package changes nothing. (rmw_fastrtps_cpp needs the introspection in C.)
find_package(rosidl_default_generators REQUIRED)
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")
