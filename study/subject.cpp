#include "study/subject.hpp"

#include <algorithm>
#include <utility>

#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"

namespace tactus::study {

Subject make_subject(const std::string& name, const std::string& source, std::uint32_t faces, double size) {
  using namespace spm::offline;
  const std::vector<std::string_view> shapes = shape_names();
  if (std::find(shapes.begin(), shapes.end(), source) == shapes.end())
    return make_subject(name, source, import_mesh(source), size, 0);
  return make_subject(name, source + ", " + std::to_string(faces) + " faces", generate(shape_from_name(source), faces),
                      size, 0);
}

Subject make_subject(const std::string& name, const std::string& source, spm::offline::TriangleMesh mesh, double size,
                     unsigned threads) {
  spm::offline::BuildOptions options;
  options.size = size;
  options.threads = threads;
  Subject subject;
  subject.name = name;
  subject.source = source;
  subject.built = std::make_unique<const spm::offline::BuiltModel>(spm::offline::build_model(std::move(mesh), options));
  subject.model = subject.built->model();
  subject.encoded = std::make_unique<const spm::codec::EncodedModel>(subject.model);
  subject.finest = finest_faces(subject.model);
  return subject;
}

}  // namespace tactus::study
