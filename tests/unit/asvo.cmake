add_executable(asvo_test ${CMAKE_CURRENT_LIST_DIR}/asvo_build_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/asvo_parts_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/asvo_trace_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/asvo_format_test.cpp)
target_link_libraries(asvo_test PRIVATE asvo GTest::gtest_main)
trex_gtest(asvo_test)
