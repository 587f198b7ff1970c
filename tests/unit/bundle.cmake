add_executable(bundle_test ${CMAKE_CURRENT_LIST_DIR}/bundle_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/bundle_hostile_test.cpp)
target_link_libraries(bundle_test PRIVATE trex_bundle GTest::gtest_main)
trex_gtest(bundle_test)

add_test(NAME bake_test COMMAND ${Python3_EXECUTABLE} ${CMAKE_CURRENT_LIST_DIR}/bake_test.py
  --trex $<TARGET_FILE:trex> --assets ${CMAKE_SOURCE_DIR}/assets)
set_tests_properties(bake_test PROPERTIES LABELS program TIMEOUT 900)

add_test(NAME stream_bake_test COMMAND ${Python3_EXECUTABLE}
  ${CMAKE_CURRENT_LIST_DIR}/stream_bake_test.py --trex $<TARGET_FILE:trex>
  --assets ${CMAKE_SOURCE_DIR}/assets)
set_tests_properties(stream_bake_test PROPERTIES LABELS program TIMEOUT 600)
