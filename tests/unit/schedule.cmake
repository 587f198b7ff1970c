add_executable(schedule_test ${CMAKE_CURRENT_LIST_DIR}/schedule_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/schedule_timing_test.cpp ${CMAKE_CURRENT_LIST_DIR}/schedule_offload_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/schedule_bound_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/schedule_simulator_test.cpp)
target_link_libraries(schedule_test PRIVATE trex_schedule GTest::gtest_main)
trex_gtest(schedule_test)
