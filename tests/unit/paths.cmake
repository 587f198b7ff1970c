add_executable(batched_tracer_test ${CMAKE_CURRENT_LIST_DIR}/batched_tracer_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/load_choice_test.cpp ${CMAKE_CURRENT_LIST_DIR}/walks_test.cpp)
target_link_libraries(batched_tracer_test PRIVATE trex_paths GTest::gtest_main)
trex_gtest(batched_tracer_test)
trex_program_test(ray_batching_test ray_batching_test.py)
trex_program_test(batching_failures_test batching_failures_test.py)
