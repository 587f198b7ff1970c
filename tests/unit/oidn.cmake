# Libraries that pretend to be Open Image Denoise.
foreach(fake fake_oidn fake_oidn_old)
  add_library(${fake} MODULE ${CMAKE_CURRENT_LIST_DIR}/fake_oidn.cpp)
  target_link_libraries(${fake} PRIVATE trex_options)
endforeach()
target_compile_definitions(fake_oidn_old PRIVATE FAKE_OIDN_OLD)
add_executable(oidn_test ${CMAKE_CURRENT_LIST_DIR}/oidn_test.cpp)
target_link_libraries(oidn_test PRIVATE trex_frame GTest::gtest_main)
target_compile_definitions(oidn_test PRIVATE TREX_FAKE_OIDN="$<TARGET_FILE:fake_oidn>"
  TREX_FAKE_OIDN_OLD="$<TARGET_FILE:fake_oidn_old>")
add_dependencies(oidn_test fake_oidn fake_oidn_old)
trex_gtest(oidn_test)
trex_program_test(oidn_command_test oidn_command_test.py --fake $<TARGET_FILE:fake_oidn>)
