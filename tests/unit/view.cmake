add_test(NAME view_test COMMAND ${Python3_EXECUTABLE} ${CMAKE_CURRENT_LIST_DIR}/view_test.py
  --trex $<TARGET_FILE:trex> --assets ${CMAKE_SOURCE_DIR}/assets)
set_tests_properties(view_test PROPERTIES LABELS program TIMEOUT 600)
