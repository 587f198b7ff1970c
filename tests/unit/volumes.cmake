if(TARGET trex_vdb)
  # Writes .vdb files for tests: OpenVDB's own.
  add_executable(make_vdb ${CMAKE_CURRENT_LIST_DIR}/make_vdb.cpp)
  target_include_directories(make_vdb SYSTEM PRIVATE ${OPENVDB_INCLUDE_DIR})
  find_library(IMATH_LIBRARY NAMES Imath Imath-3_1 REQUIRED)  # half floats in its headers
  target_link_libraries(make_vdb PRIVATE trex_options ${OPENVDB_LIBRARY} ${IMATH_LIBRARY} TBB::tbb)
endif()

add_executable(media_test ${CMAKE_CURRENT_LIST_DIR}/media_test.cpp)
target_link_libraries(media_test PRIVATE trex_paths GTest::gtest_main)
trex_gtest(media_test)
if(TARGET make_vdb)
  trex_program_test(volume_test volume_test.py --make $<TARGET_FILE:make_vdb>)
endif()
