add_executable(extremes_test ${CMAKE_CURRENT_LIST_DIR}/extremes_shape_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/extremes_light_test.cpp)
target_link_libraries(extremes_test PRIVATE trex_test_image)
target_compile_definitions(extremes_test PRIVATE TREX_LONG_FRAMES=1000000u)
add_dependencies(extremes_test test_scenes)
trex_gtest(extremes_test SLOW)
trex_program_test(extremes_program_test extremes_test.py)
