add_executable(bundle_test ${CMAKE_CURRENT_LIST_DIR}/bundle_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/bundle_hostile_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/two_sets_test.cpp)
target_link_libraries(bundle_test PRIVATE trex_bundle GTest::gtest_main)
trex_gtest(bundle_test)

trex_program_test(bake_test bake_test.py)

trex_program_test(stream_bake_test stream_bake_test.py)
