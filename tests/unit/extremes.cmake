add_executable(extremes_test ${CMAKE_CURRENT_LIST_DIR}/extremes_shape_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/extremes_light_test.cpp)
target_link_libraries(extremes_test PRIVATE trex_test_image)
target_compile_definitions(extremes_test PRIVATE TREX_LONG_FRAMES=1000000u)
add_dependencies(extremes_test test_scenes)
trex_gtest(extremes_test SLOW)
add_test(NAME extremes_program_test COMMAND ${Python3_EXECUTABLE}
  ${CMAKE_CURRENT_LIST_DIR}/extremes_test.py --trex $<TARGET_FILE:trex>)
set_tests_properties(extremes_program_test PROPERTIES LABELS program TIMEOUT 900)
