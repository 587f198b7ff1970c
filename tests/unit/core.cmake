add_executable(core_test ${CMAKE_CURRENT_LIST_DIR}/sampler_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/file_test.cpp ${CMAKE_CURRENT_LIST_DIR}/threads_test.cpp)
target_link_libraries(core_test PRIVATE trex_core GTest::gtest_main)
trex_gtest(core_test)
