add_test(NAME app_test COMMAND ${Python3_EXECUTABLE} ${CMAKE_CURRENT_LIST_DIR}/app_test.py
  --trex $<TARGET_FILE:trex> --assets ${CMAKE_SOURCE_DIR}/assets)
set_tests_properties(app_test PROPERTIES TIMEOUT 900)
add_test(NAME asvo_command_test COMMAND ${Python3_EXECUTABLE} ${CMAKE_CURRENT_LIST_DIR}/asvo_command_test.py
  --trex $<TARGET_FILE:trex> --assets ${CMAKE_SOURCE_DIR}/assets)
set_tests_properties(asvo_command_test PROPERTIES LABELS program TIMEOUT 600)
