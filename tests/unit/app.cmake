trex_program_test(pbrt_test pbrt_test.py)
trex_program_test(app_test app_test.py --assets ${CMAKE_SOURCE_DIR}/assets)
trex_program_test(asvo_command_test asvo_command_test.py --assets ${CMAKE_SOURCE_DIR}/assets)
trex_program_test(two_sets_test two_sets_test.py)
