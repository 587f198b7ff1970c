add_executable(grays_test ${CMAKE_CURRENT_LIST_DIR}/grays_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/grays_photon_test.cpp ${CMAKE_CURRENT_LIST_DIR}/vulkan_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/device_failure_test.cpp ${CMAKE_CURRENT_LIST_DIR}/paged_test.cpp)
target_link_libraries(grays_test PRIVATE trex_grays trex_vulkan asvo GTest::gtest_main)
trex_gtest(grays_test)
