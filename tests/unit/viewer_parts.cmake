# The parts of the viewer that need no window.
add_executable(viewer_parts_test ${CMAKE_CURRENT_LIST_DIR}/camera_control_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/look_history_test.cpp ${CMAKE_CURRENT_LIST_DIR}/replay_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/viewer_parts_test.cpp)
target_link_libraries(viewer_parts_test PRIVATE trex_viewer GTest::gtest_main)
trex_gtest(viewer_parts_test)
