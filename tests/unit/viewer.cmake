add_executable(viewer_test ${CMAKE_CURRENT_LIST_DIR}/viewer_test.cpp)
target_compile_definitions(viewer_test PRIVATE TREX_ASSETS="${CMAKE_SOURCE_DIR}/assets")
target_link_libraries(viewer_test PRIVATE trex_viewer GTest::gtest_main)
trex_gtest(viewer_test)
