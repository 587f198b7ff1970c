#include "src/vdb/vdb.h"

#include <openvdb/io/File.h>
#include <openvdb/openvdb.h>

#include <exception>
#include <string>

namespace {

openvdb::Vec3s vectorOf(const float (&v)[3]) { return {v[0], v[1], v[2]}; }

template <typename Grid>
typename Grid::Ptr makeGrid(const char* name, const openvdb::math::Transform::Ptr& transform) {
  typename Grid::Ptr grid = Grid::create();
  grid->setName(name);
  grid->setTransform(transform);
  return grid;
}

void write(const char* path, const TrexVdbVoxel* voxels, std::uint64_t count, double edge,
           const double lower[3]) {
  openvdb::initialize();
  const auto transform = openvdb::math::Transform::createLinearTransform(edge);
  // An index names the centre of its voxel.
  transform->postTranslate(openvdb::Vec3d(lower[0], lower[1], lower[2]) +
                           openvdb::Vec3d(0.5 * edge));
  const auto coverage = makeGrid<openvdb::FloatGrid>("coverage", transform);
  coverage->setGridClass(openvdb::GRID_FOG_VOLUME);
  const auto albedo = makeGrid<openvdb::Vec3SGrid>("albedo", transform);
  const auto normal = makeGrid<openvdb::Vec3SGrid>("normal", transform);
  const auto radiance = makeGrid<openvdb::Vec3SGrid>("radiance", transform);
  auto coverageAt = coverage->getAccessor();
  auto albedoAt = albedo->getAccessor(), normalAt = normal->getAccessor();
  auto radianceAt = radiance->getAccessor();
  for (std::uint64_t i = 0; i < count; ++i) {
    const TrexVdbVoxel& v = voxels[i];
    const openvdb::Coord place(v.place[0], v.place[1], v.place[2]);
    coverageAt.setValue(place, v.coverage);
    albedoAt.setValue(place, vectorOf(v.albedo));
    normalAt.setValue(place, vectorOf(v.normal));
    radianceAt.setValue(place, vectorOf(v.radiance));
  }
  openvdb::io::File file(path);
  file.write(openvdb::GridPtrVec{coverage, albedo, normal, radiance});
  file.close();
}

}  // namespace

extern "C" const char* trexWriteVdb(const char* path, const TrexVdbVoxel* voxels,
                                    std::uint64_t count, double edge, const double lower[3]) {
  thread_local std::string error;
  try {
    write(path, voxels, count, edge, lower);
    return nullptr;
  } catch (const std::exception& e) {
    error = e.what();
    return error.c_str();
  }
}
