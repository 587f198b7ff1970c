add_executable(stat_test ${CMAKE_CURRENT_LIST_DIR}/reference_test.cpp)
target_link_libraries(stat_test PRIVATE trex_session GTest::gtest_main)
target_compile_definitions(stat_test PRIVATE TREX_SOURCE_DIR="${CMAKE_SOURCE_DIR}"
  TREX_ARTEFACT_DIR="${CMAKE_BINARY_DIR}/artefacts")
trex_gtest(stat_test SLOW)
