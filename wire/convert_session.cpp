#include "wire/convert.hpp"

namespace tactus::wire {

void to_idl(const session::RosterEntry& from, idl::RosterEntry& to) {
  origin_to_idl(from.origin, to);
  to.protocol(from.protocol);
  to.participant_role(static_cast<idl::ParticipantRole>(from.role));
  to.name(from.name);
  to.session(from.session);
  to.requested_hrtc(from.requested_hrtc);
  to.users().resize(from.users.size());
  for (std::size_t i = 0; i < from.users.size(); ++i) to.users()[i].user(from.users[i]);
  to.served_users().resize(from.served_users.size());
  for (std::size_t i = 0; i < from.served_users.size(); ++i) {
    to.served_users()[i].user(from.served_users[i].user);
    to.served_users()[i].probe_number(from.served_users[i].probe);
  }
  to.heartbeat(from.heartbeat);
  to.leaving(from.leaving);
  to.stops().resize(from.stops.size());
  for (std::size_t i = 0; i < from.stops.size(); ++i) {
    to.stops()[i].participant(from.stops[i].participant);
    to.stops()[i].incarnation(from.stops[i].incarnation);
    to.stops()[i].newest_stop(from.stops[i].stop);
    to.stops()[i].ended(from.stops[i].ended);
    to.stops()[i].newest_reset(from.stops[i].reset);
  }
  to.reference(from.reference);
  to.session_time_ns(from.session_time_ns);
  to.joined_ns(from.joined_ns);
  to.force_on(from.force_on);
  to.revoked_made_s(from.revoked_made_s);
}

void from_idl(const idl::RosterEntry& from, session::RosterEntry& to) {
  to.origin = origin_from_idl(from);
  to.protocol = from.protocol();
  to.role = enum_from_idl<session::Role>(from.participant_role());
  to.name = from.name().to_string();
  to.session = from.session().to_string();
  to.requested_hrtc = from.requested_hrtc().to_string();
  to.users.resize(from.users().size());
  for (std::size_t i = 0; i < to.users.size(); ++i) to.users[i] = from.users()[i].user().to_string();
  to.served_users.resize(from.served_users().size());
  for (std::size_t i = 0; i < to.served_users.size(); ++i) {
    to.served_users[i] = {from.served_users()[i].user().to_string(), from.served_users()[i].probe_number()};
  }
  to.heartbeat = from.heartbeat();
  to.leaving = from.leaving();
  to.stops.resize(from.stops().size());
  for (std::size_t i = 0; i < to.stops.size(); ++i) {
    const idl::StopRecordValue& stop = from.stops()[i];
    to.stops[i] = {stop.participant(), stop.incarnation(), stop.newest_stop(), stop.ended(), stop.newest_reset()};
  }
  to.reference = from.reference();
  to.session_time_ns = from.session_time_ns();
  to.joined_ns = from.joined_ns();
  to.force_on = from.force_on();
  to.revoked_made_s = from.revoked_made_s();
}

void to_idl(const session::CatalogueEntry& from, idl::CatalogueEntry& to) {
  origin_to_idl(from.origin, to);
  to.object_id(from.object_id);
  to.host(from.host);
  to.object_name(from.object);
  idl::ModelSummaryValue& summary = to.summary();
  summary.digest(from.summary.digest);
  summary.vertices(from.summary.vertices);
  summary.faces(from.summary.faces);
  summary.base_vertices(from.summary.base_vertices);
  summary.base_faces(from.summary.base_faces);
  summary.records(from.summary.records);
  summary.parts(from.summary.parts);
  summary.regions(from.summary.regions);
  summary.max_level(from.summary.max_level);
  summary.bounds_min(from.summary.bounds_min);
  summary.bounds_max(from.summary.bounds_max);
  summary.grid_origin(from.summary.grid.origin);
  summary.cell_size(from.summary.grid.cell_size);
  summary.metres_per_unit(from.summary.metres_per_unit);
  summary.deviation(from.summary.deviation);
  summary.position_step(from.summary.position_step);
  to.scale(from.scale);
  to.placement(pose_to_idl(from.pose));
  to.surface().stiffness(from.material.stiffness);
  to.surface().damping(from.material.damping);
  to.surface().static_friction(from.material.static_friction);
  to.surface().dynamic_friction(from.material.dynamic_friction);
  to.body().mass(from.body.mass);
  to.body().inertia(from.body.inertia);
  to.body().friction(from.body.friction);
  to.body().ground(from.body.ground);
  to.base_bytes(from.base_bytes);
  to.surface_points().resize(from.surface.points.size());
  for (std::size_t i = 0; i < from.surface.points.size(); ++i) {
    to.surface_points()[i].position(from.surface.points[i].position);
    to.surface_points()[i].normal(from.surface.points[i].normal);
  }
  to.surface_spacing(from.surface.spacing);
  to.withdrawn(from.withdrawn);
}

void from_idl(const idl::CatalogueEntry& from, session::CatalogueEntry& to) {
  to.origin = origin_from_idl(from);
  to.object_id = from.object_id();
  to.host = from.host().to_string();
  to.object = from.object_name().to_string();
  const idl::ModelSummaryValue& summary = from.summary();
  to.summary.digest = summary.digest();
  to.summary.vertices = summary.vertices();
  to.summary.faces = summary.faces();
  to.summary.base_vertices = summary.base_vertices();
  to.summary.base_faces = summary.base_faces();
  to.summary.records = summary.records();
  to.summary.parts = summary.parts();
  to.summary.regions = summary.regions();
  to.summary.max_level = summary.max_level();
  to.summary.bounds_min = summary.bounds_min();
  to.summary.bounds_max = summary.bounds_max();
  to.summary.grid = {summary.grid_origin(), summary.cell_size()};
  to.summary.metres_per_unit = summary.metres_per_unit();
  to.summary.deviation = summary.deviation();
  to.summary.position_step = summary.position_step();
  to.scale = from.scale();
  to.pose = pose_from_idl(from.placement());
  to.material = {from.surface().stiffness(), from.surface().damping(), from.surface().static_friction(),
                 from.surface().dynamic_friction()};
  to.body = {from.body().mass(), from.body().inertia(), from.body().friction(), from.body().ground()};
  to.base_bytes = from.base_bytes();
  to.surface.points.resize(from.surface_points().size());
  for (std::size_t i = 0; i < to.surface.points.size(); ++i)
    to.surface.points[i] = {from.surface_points()[i].position(), from.surface_points()[i].normal()};
  to.surface.spacing = from.surface_spacing();
  to.withdrawn = from.withdrawn();
}

void to_idl(const session::Metrics& from, idl::Metrics& to) {
  origin_to_idl(from.origin, to);
  to.figures().resize(from.figures.size());
  for (std::size_t i = 0; i < from.figures.size(); ++i) {
    to.figures()[i].name(from.figures[i].name);
    to.figures()[i].value(from.figures[i].value);
  }
  to.scene(from.scene);
  to.meshes().resize(from.meshes.size());
  for (std::size_t i = 0; i < from.meshes.size(); ++i) {
    to.meshes()[i].object_id(from.meshes[i].object_id);
    to.meshes()[i].hash(from.meshes[i].hash);
  }
}

void from_idl(const idl::Metrics& from, session::Metrics& to) {
  to.origin = origin_from_idl(from);
  to.figures.resize(from.figures().size());
  for (std::size_t i = 0; i < to.figures.size(); ++i) {
    to.figures[i] = {from.figures()[i].name().to_string(), from.figures()[i].value()};
  }
  to.scene = from.scene();
  to.meshes.resize(from.meshes().size());
  for (std::size_t i = 0; i < to.meshes.size(); ++i) {
    to.meshes[i] = {from.meshes()[i].object_id(), from.meshes()[i].hash()};
  }
}

void to_idl(const session::ShownRegions& from, idl::ShownRegions& to) {
  origin_to_idl(from.origin, to);
  to.object_id(from.object_id);
  to.digest(from.digest);
  to.mesh_hash(from.mesh_hash);
  to.complete(from.complete);
  to.regions().resize(from.regions.size());
  for (std::size_t i = 0; i < from.regions.size(); ++i) {
    to.regions()[i].region(from.regions[i].region);
    to.regions()[i].applied(from.regions[i].applied);
  }
}

void from_idl(const idl::ShownRegions& from, session::ShownRegions& to) {
  to.origin = origin_from_idl(from);
  to.object_id = from.object_id();
  to.digest = from.digest();
  to.mesh_hash = from.mesh_hash();
  to.complete = from.complete();
  to.regions.resize(from.regions().size());
  for (std::size_t i = 0; i < to.regions.size(); ++i)
    to.regions[i] = {from.regions()[i].region(), from.regions()[i].applied()};
}

void to_idl(const session::Control& from, idl::Control& to) {
  origin_to_idl(from.origin, to);
  to.sequence_number(from.sequence);
  to.action(static_cast<idl::ControlAction>(from.kind));
  to.text(from.text);
}

void from_idl(const idl::Control& from, session::Control& to) {
  to.origin = origin_from_idl(from);
  to.sequence = from.sequence_number();
  to.kind = enum_from_idl<session::ControlKind>(from.action());
  to.text = from.text().to_string();
}

void to_idl(const session::ForceReset& from, idl::ForceReset& to) {
  origin_to_idl(from.origin, to);
  to.reset_number(from.number);
  to.stops().resize(from.stops.size());
  for (std::size_t i = 0; i < from.stops.size(); ++i) {
    to.stops()[i].participant(from.stops[i].participant);
    to.stops()[i].incarnation(from.stops[i].incarnation);
    to.stops()[i].stop_number(from.stops[i].number);
  }
  to.text(from.text);
}

void from_idl(const idl::ForceReset& from, session::ForceReset& to) {
  to.origin = origin_from_idl(from);
  to.number = from.reset_number();
  to.stops.resize(from.stops().size());
  for (std::size_t i = 0; i < to.stops.size(); ++i) {
    const idl::StopNameValue& stop = from.stops()[i];
    to.stops[i] = {stop.participant(), stop.incarnation(), stop.stop_number()};
  }
  to.text = from.text().to_string();
}

void to_idl(const session::SessionEnd& from, idl::SessionEnd& to) {
  origin_to_idl(from.origin, to);
  to.text(from.text);
}

void from_idl(const idl::SessionEnd& from, session::SessionEnd& to) {
  to.origin = origin_from_idl(from);
  to.text = from.text().to_string();
}

}  // namespace tactus::wire
