add_executable(fuzz_regressions_test ${CMAKE_CURRENT_LIST_DIR}/scene_helpers.cpp
  ${CMAKE_CURRENT_LIST_DIR}/fuzz_regressions_test.cpp)
target_link_libraries(fuzz_regressions_test PRIVATE trex_scene GTest::gtest_main)
trex_gtest(fuzz_regressions_test)
