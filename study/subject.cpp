#include "study/subject.hpp"

#include <algorithm>

#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"

namespace tactus::study {

Subject make_subject(const std::string& name, const std::string& source, std::uint32_t faces, double size) {
  using namespace spm::offline;
  const std::vector<std::string_view> shapes = shape_names();
  const bool generated = std::find(shapes.begin(), shapes.end(), source) != shapes.end();
  BuildOptions options;
  options.size = size;
  Subject subject;
  subject.name = name;
  subject.source = generated ? source + ", " + std::to_string(faces) + " faces" : source;
  subject.built = std::make_unique<const BuiltModel>(
      build_model(generated ? generate(shape_from_name(source), faces) : import_mesh(source), options));
  subject.model = subject.built->model();
  subject.encoded = std::make_unique<const spm::codec::EncodedModel>(subject.model);
  subject.finest = finest_faces(subject.model);
  return subject;
}

}  // namespace tactus::study
