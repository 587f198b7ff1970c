# What image tests and extremes share.
add_library(trex_test_image STATIC ${CMAKE_CURRENT_LIST_DIR}/rendered.cpp
  ${CMAKE_CURRENT_LIST_DIR}/reference.cpp)
target_link_libraries(trex_test_image PUBLIC trex_session GTest::gtest_main)
target_compile_definitions(trex_test_image PUBLIC TREX_SOURCE_DIR="${CMAKE_SOURCE_DIR}"
  TREX_SCENE_DIR="${CMAKE_BINARY_DIR}/test_scenes"
  TREX_ARTEFACT_DIR="${CMAKE_BINARY_DIR}/artefacts")

set(test_scenes ${CMAKE_BINARY_DIR}/test_scenes/stamp)
add_custom_command(OUTPUT ${test_scenes}
  COMMAND ${Python3_EXECUTABLE} ${CMAKE_CURRENT_LIST_DIR}/scenes.py ${CMAKE_BINARY_DIR}/test_scenes
  COMMAND ${CMAKE_COMMAND} -E touch ${test_scenes}
  DEPENDS ${CMAKE_CURRENT_LIST_DIR}/scenes.py ${CMAKE_SOURCE_DIR}/assets/make_assets.py VERBATIM)
add_custom_target(test_scenes DEPENDS ${test_scenes})

foreach(name image mitsuba regression shared_leaves)
  add_executable(${name}_test ${CMAKE_CURRENT_LIST_DIR}/${name}_test.cpp)
  target_link_libraries(${name}_test PRIVATE trex_test_image)
  add_dependencies(${name}_test test_scenes)
  trex_gtest(${name}_test SLOW)
endforeach()
