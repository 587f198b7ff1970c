trex_program_test(app_test app_test.py --assets ${CMAKE_SOURCE_DIR}/assets)
