# wineglass_twin: what Python loads. Every object of every room, but only WG_EXPORT functions are visible.

get_property(rooms GLOBAL PROPERTY WINEGLASS_ROOMS)
if(NOT host IN_LIST rooms AND NOT sim IN_LIST rooms)
  return()
endif()

add_library(wineglass_twin SHARED)
set_target_properties(wineglass_twin PROPERTIES EXPORT_NAME twin LINKER_LANGUAGE C)
foreach(room IN LISTS rooms)
  target_sources(wineglass_twin PRIVATE $<TARGET_OBJECTS:wineglass_${room}>)
endforeach()
target_link_libraries(wineglass_twin PRIVATE m $<BUILD_INTERFACE:wineglass_sanitizers>)
