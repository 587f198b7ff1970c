trex_program_test(assimp_test assimp_test.py)
