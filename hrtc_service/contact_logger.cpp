#include "hrtc_service/contact_logger.hpp"

namespace tactus::hrtc_service {

ContactLogger::ContactLogger(const std::filesystem::path& file, ContactQuery::LogRing& queries)
    : log_{file}, queries_{queries} {
  numbers_.fill(spm::kNone);
}

void ContactLogger::add(const ObjectDescription& object) {
  numbers_[object.index] = next_number_++;
  log_.write(trace::LoggedObject{numbers_[object.index], object.digest, object.placement.scale(), object.name});
}

bool ContactLogger::drain() {
  while (queries_.pop(query_)) {
    query_.object = numbers_[query_.object];
    if (query_.object != spm::kNone) log_.write(query_);
  }
  log_.flush();
  return log_.healthy();
}

void ContactLogger::close(const Loader::ObjectInfo& object) {
  static_cast<void>(drain());
  log_.write(trace::LoggedTotals{numbers_[object.index], object.records_received, object.records_received_again,
                                 object.regions_received, object.regions_released});
}

}  // namespace tactus::hrtc_service
