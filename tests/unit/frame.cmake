add_executable(frame_test ${CMAKE_CURRENT_LIST_DIR}/estimator_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/frame_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/denoise_test.cpp ${CMAKE_CURRENT_LIST_DIR}/correction_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/lattice_light_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/light_memory_test.cpp ${CMAKE_CURRENT_LIST_DIR}/look_image_test.cpp)
target_link_libraries(frame_test PRIVATE trex_frame trex_openimageio GTest::gtest_main)
trex_gtest(frame_test)
