#include "viewer/page_server.hpp"

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/host_name.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <cctype>
#include <chrono>
#include <fstream>
#include <iterator>
#include <list>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <utility>

#include "session/periodic.hpp"
#include "session/units.hpp"

namespace tactus::viewer {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;

namespace {

constexpr std::chrono::seconds kHttpTimeout{10};
constexpr std::uint32_t kMaxRefusalEvents = 10;  // in a second
// Max number of sent messages that the page has not processed. A browser receives messages while its page is busy, so
// more of them would form a queue of old states.
constexpr std::uint64_t kMaxUnseen = 8;
constexpr std::int64_t kReaderNs = 1'000 * kMs;  // a page that could receive a message in this time is a reader
constexpr int kSendBufferBytes = 64 * 1024;      // of a page
constexpr std::int64_t kTokenTimeoutNs = 5'000 * kMs;
constexpr std::uint32_t kMaxHeaderBytes = 8192;
constexpr std::chrono::milliseconds kMaxPoll{5};
constexpr std::int64_t kRefusalEventNs = 1'000 * kMs;  // min time between two events about refused requests
constexpr char kSocketPath[] = "/session";
const std::string kTooManyPages = std::to_string(PageServer::kMaxPages) + " pages are connected already";

struct File {
  std::string type, bytes;
};

std::string media_type(const std::filesystem::path& file) {
  const std::string extension = file.extension().string();
  if (extension == ".html") return "text/html; charset=utf-8";
  if (extension == ".js") return "text/javascript";
  if (extension == ".css") return "text/css";
  if (extension == ".wasm") return "application/wasm";
  return "application/octet-stream";
}

std::map<std::string, File> read_files(const std::filesystem::path& folder) {
  std::map<std::string, File> files;
  std::error_code error;
  const std::filesystem::directory_iterator end;
  for (std::filesystem::directory_iterator at{folder, error}; !error && at != end; at.increment(error)) {
    const std::filesystem::directory_entry& entry = *at;
    std::error_code ignored;
    if (!entry.is_regular_file(ignored)) continue;
    std::ifstream in{entry.path(), std::ios::binary};
    files["/" + entry.path().filename().string()] = {
        media_type(entry.path()), {std::istreambuf_iterator<char>{in}, std::istreambuf_iterator<char>{}}};
  }
  const auto index = files.find("/index.html");
  if (index == files.end())
    throw ServerError{"no page in " + folder.string() +
                      ": found no index.html; the package tactus has the page, scripts/page builds it, and --page can "
                      "name its folder"};
  files["/"] = index->second;
  return files;
}

std::string_view text_of(boost::string_view text) { return {text.data(), text.size()}; }

std::string lower_case(std::string_view text) {
  std::string lower{text};
  std::transform(lower.begin(), lower.end(), lower.begin(), [](unsigned char byte) { return std::tolower(byte); });
  return lower;
}

/// Returns whether `text`, as HOST or HOST:PORT, is an address, or a name of this machine. A foreign web site has a name
/// of its own, so its pages never send such a Host.
bool is_own(std::string_view text) {
  const std::size_t end = text.rfind(':');
  if (end != std::string_view::npos && text.back() != ']') text = text.substr(0, end);
  if (text.size() > 2 && text.front() == '[') text = text.substr(1, text.size() - 2);
  const std::string host = lower_case(text), own = lower_case(host_name());
  beast::error_code error;
  asio::ip::make_address(host, error);
  return !error || host == "localhost" || (!own.empty() && (host == own || host == own + ".local"));
}

/// Returns the first bytes of a text from outside, for an event.
std::string shortened(std::string_view text) {
  constexpr std::size_t kMax = 100;
  return text.size() <= kMax ? std::string{text} : std::string{text.substr(0, kMax)} + "...";
}

/// Compares in a time that does not depend on the first different byte. False for an empty secret.
bool is_same_secret(std::string_view given, std::string_view secret) {
  if (secret.empty() || given.size() != secret.size()) return false;
  unsigned difference = 0;
  for (std::size_t i = 0; i < secret.size(); ++i) difference |= static_cast<unsigned char>(given[i] ^ secret[i]);
  return difference == 0;
}

/// Counts requests in steps of one second.
class RequestCounter {
 public:
  /// Counts a request. Returns whether there were more than `limit` in this second.
  bool exceeds(std::uint32_t limit) {
    const auto now = std::chrono::steady_clock::now();
    if (now - began_ > std::chrono::seconds{1}) {
      began_ = now;
      count_ = 0;
    }
    return ++count_ > limit;
  }

 private:
  std::chrono::steady_clock::time_point began_;
  std::uint32_t count_ = 0;
};

}  // namespace

struct PageServer::Impl {
  struct Page;
  struct Exchange;

  Impl(PageServer& owner, const ServerSettings& settings, const ViewerCore& viewer, const PlaybackStatus* status)
      : server{owner},
        core{viewer},
        playback{status},
        control_token{settings.control_token},
        observer_token{settings.observer_token},
        files{read_files(settings.folder)},
        acceptor{io} {
    files["/tool.json"] = {"application/json", settings.tool};
    files["/session.json"] = {"application/json", settings.is_plain ? R"({"isPlain":true})" : R"({"isPlain":false})"};
    beast::error_code error;
    const asio::ip::address address = asio::ip::make_address(settings.address, error);
    if (error) throw ServerError{"address '" + settings.address + "': expected an IP address, for example 127.0.0.1"};
    const tcp::endpoint endpoint{address, settings.port};
    acceptor.open(endpoint.protocol(), error);
    if (!error) acceptor.set_option(asio::socket_base::reuse_address{true}, error);
    if (!error) acceptor.bind(endpoint, error);
    if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
    if (error)
      throw ServerError{"cannot listen at " + settings.address + ", port " + std::to_string(settings.port) + ": " +
                        error.message() + "; --port can choose another"};
  }

  [[nodiscard]] std::size_t pages_with_rights() const;
  void accept();
  void run_handlers();
  void report(const std::string& text) const {
    if (server.on_event) server.on_event(text);
  }

  PageServer& server;
  const ViewerCore& core;
  const PlaybackStatus* playback;
  std::string control_token, observer_token;
  std::map<std::string, File> files;
  asio::io_context io{1};
  tcp::acceptor acceptor;
  std::list<std::shared_ptr<Page>> pages;
  std::size_t exchanges = 0;  // number of unfinished HTTP requests
  PageId last_page = 0;       // number of the newest page
  bool accepts = false;       // an accept is under way
  std::int64_t now_ns = 0;    // of the last poll
  session::PeriodicTimer refusals{kRefusalEventNs};
  RequestCounter refused_pages;
};

/// A page with an open WebSocket.
struct PageServer::Impl::Page : std::enable_shared_from_this<Page> {
  /// What a page may do. kNothing: it has sent no token yet.
  enum class Rights : std::uint8_t { kNothing, kObserve, kControl };

  Page(Impl& owner, beast::tcp_stream&& stream)
      : impl{owner}, id{++owner.last_page}, socket{std::move(stream)}, feed{owner.core, owner.playback} {
    beast::error_code error;
    beast::get_lowest_layer(socket).socket().set_option(tcp::no_delay{true}, error);
    socket.auto_fragment(false);  // a mesh can have megabytes
    name = beast::get_lowest_layer(socket).socket().remote_endpoint(error).address().to_string();
    name += ":" + std::to_string(beast::get_lowest_layer(socket).socket().remote_endpoint(error).port());
  }

  void open(const http::request<http::string_body>& request) {
    beast::get_lowest_layer(socket).expires_never();
    websocket::stream_base::timeout timeouts{};
    timeouts.handshake_timeout = kHttpTimeout;
    timeouts.idle_timeout = std::chrono::seconds{20};
    timeouts.keep_alive_pings = true;
    socket.set_option(timeouts);
    // A large buffer of the kernel would be a queue of old frames.
    beast::error_code ignored;
    beast::get_lowest_layer(socket).socket().set_option(asio::socket_base::send_buffer_size{kSendBufferBytes}, ignored);
    socket.read_message_max(kMaxRequestBytes);
    socket.async_accept(request, [self = shared_from_this()](beast::error_code error) {
      if (error) return self->close();
      self->is_open = true;
      self->opened_ns = self->impl.now_ns;
      if (self->impl.control_token.empty()) self->grant(Rights::kControl);
      self->read();
    });
  }

  void grant(Rights granted) {
    rights = granted;
    rights_message = nlohmann::json{{"type", "rights"}, {"control", granted == Rights::kControl}}.dump();
  }

  void read() {
    socket.async_read(received, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error == websocket::error::message_too_big)
        return self->refuse("a request is longer than " + std::to_string(kMaxRequestBytes) + " bytes");
      if (error.category() == beast::error_code{websocket::error::closed}.category() &&
          error != websocket::error::closed)
        return self->refuse("it sent no valid message: " + error.message());
      if (error) return self->close();
      self->process(beast::buffers_to_string(self->received.data()));
      self->received.clear();
      if (self->is_open) self->read();
    });
  }

  void process(const std::string& text) {
    const std::optional<PageRequest> request = parse_request(text);
    if (const auto* const processed = request ? std::get_if<SeenRequest>(&*request) : nullptr)
      return process(*processed);
    if (requests.exceeds(kMaxRequestsPerSecond))
      return refuse("it sends more than " + std::to_string(kMaxRequestsPerSecond) + " requests a second");
    if (!request) return refuse("it sent no valid request");
    if (const auto* const given = std::get_if<TokenRequest>(&*request)) return process(*given);
    if (rights != Rights::kControl) return refuse("its token is for observers, and it sent a request");
    if (impl.server.on_request) impl.server.on_request(id, *request);
  }

  /// Each number must be larger than the last one. So a page can send at most one of these requests for each message,
  /// and the limit of requests does not count them.
  void process(const SeenRequest& processed) {
    if (processed.messages <= seen || processed.messages > sent)
      return refuse("found \"seen\" " + std::to_string(processed.messages) + ", expected " + std::to_string(seen + 1) +
                    " to " + std::to_string(sent));
    seen = processed.messages;
    write();
  }

  void process(const TokenRequest& given) {
    if (rights == Rights::kNothing && impl.pages_with_rights() >= kMaxPages) return refuse(kTooManyPages);
    if (impl.control_token.empty()) return;  // a token of an earlier viewer
    if (is_same_secret(given.token, impl.control_token)) return grant(Rights::kControl);
    if (is_same_secret(given.token, impl.observer_token)) return grant(Rights::kObserve);
    refuse("it sent a wrong token");
  }

  void refuse(const std::string& reason) {
    // Old pages with a wrong token, of which there may be many, must not displace all other events.
    if (!impl.refused_pages.exceeds(kMaxRefusalEvents)) impl.report("page " + name + " is disconnected: " + reason);
    is_open = false;
    if (is_writing) return close();  // a close frame would have to wait
    socket.async_close({websocket::close_code::policy_error, reason},
                       [self = shared_from_this()](beast::error_code) { self->close(); });
  }

  /// Writes the messages that are due, one after the other, while none is being written and the page has processed
  /// enough of them.
  void write() {
    if (!is_open || is_writing || sent - seen >= kMaxUnseen) return;
    if (rights == Rights::kNothing) {
      if (impl.now_ns - opened_ns > kTokenTimeoutNs) refuse("it sent no token within 5 s");
      return;
    }
    could_receive_ns = impl.now_ns;
    std::optional<PageMessage> next;
    if (!rights_message.empty())
      next = {true, std::exchange(rights_message, {})};
    else if (!notice.empty())
      next = {true, std::exchange(notice, {})};
    else
      next = feed.next(impl.now_ns);
    if (!next) return;
    ++sent;
    outgoing = std::move(next->bytes);
    is_writing = true;
    socket.text(next->is_text);
    socket.async_write(asio::buffer(outgoing), [self = shared_from_this()](beast::error_code error, std::size_t) {
      self->is_writing = false;
      if (error) return self->close();
      self->write();
    });
  }

  void close() {
    is_open = false;
    is_closed = true;
    beast::error_code ignored;
    beast::get_lowest_layer(socket).socket().close(ignored);
  }

  Impl& impl;
  PageId id;
  Rights rights = Rights::kNothing;
  std::int64_t opened_ns = 0;
  websocket::stream<beast::tcp_stream> socket;
  PageFeed feed;
  RequestCounter requests;
  std::string name;                    // address and port
  std::string rights_message, notice;  // in JSON, go before other messages; empty: none
  beast::flat_buffer received;
  std::string outgoing;              // the message that is being written
  std::uint64_t sent = 0, seen = 0;  // number of messages
  std::int64_t could_receive_ns = -kReaderNs;
  bool is_open = false, is_writing = false, is_closed = false;
};

/// One HTTP request: answers it, or makes the connection a page.
struct PageServer::Impl::Exchange : std::enable_shared_from_this<Exchange> {
  Exchange(Impl& owner, tcp::socket&& socket) : impl{owner}, stream{std::move(socket)} { ++impl.exchanges; }
  ~Exchange() { --impl.exchanges; }

  void read() {
    stream.expires_after(kHttpTimeout);
    parser.header_limit(kMaxHeaderBytes);
    parser.body_limit(0);
    http::async_read(stream, buffer, parser, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (!error) self->process(self->parser.get());
    });
  }

  void process(const http::request<http::string_body>& request) {
    const std::string_view host = text_of(request[http::field::host]);
    const std::string_view origin = text_of(request[http::field::origin]);
    const bool is_foreign = !origin.empty() && origin != "http://" + std::string{host};
    if (!is_own(host) || is_foreign) {
      if (impl.refusals.due(impl.now_ns))
        impl.report("a request for host '" + shortened(host) + "' of origin '" + shortened(origin) + "' is refused");
      return answer(http::status::forbidden, {"text/plain", "only for pages of this server\n"});
    }
    const std::string path{text_of(request.target()).substr(0, text_of(request.target()).find('?'))};
    if (path == kSocketPath && websocket::is_upgrade(request)) {
      // Pages without a token yet do not take the places of the others.
      const auto without =
          static_cast<std::size_t>(std::count_if(impl.pages.begin(), impl.pages.end(), [](const auto& page) {
            return page->rights == Page::Rights::kNothing;
          }));
      if (without >= kMaxPages || (impl.control_token.empty() && impl.pages.size() >= kMaxPages))
        return answer(http::status::service_unavailable, {"text/plain", kTooManyPages + "\n"});
      impl.pages.push_back(std::make_shared<Page>(impl, std::move(stream)));
      return impl.pages.back()->open(request);
    }
    if (request.method() != http::verb::get)
      return answer(http::status::method_not_allowed, {"text/plain", "only GET\n"});
    const auto file = impl.files.find(path);
    if (file == impl.files.end()) return answer(http::status::not_found, {"text/plain", path + ": not found\n"});
    answer(http::status::ok, file->second);
  }

  void answer(http::status status, const File& file) {
    response = {status, 11};
    response.set(http::field::content_type, file.type);
    response.set(http::field::cache_control, "no-store");
    response.set("Content-Security-Policy",
                 "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; img-src 'self' data:; "
                 "frame-ancestors 'none'");
    response.set("X-Frame-Options", "DENY");
    response.set("X-Content-Type-Options", "nosniff");
    response.keep_alive(false);
    response.body() = file.bytes;
    response.prepare_payload();
    http::async_write(stream, response, [self = shared_from_this()](beast::error_code, std::size_t) {
      beast::error_code ignored;
      self->stream.socket().shutdown(tcp::socket::shutdown_send, ignored);
    });
  }

  Impl& impl;
  beast::tcp_stream stream;
  beast::flat_buffer buffer;
  http::request_parser<http::string_body> parser;
  http::response<http::string_body> response;
};

std::size_t PageServer::Impl::pages_with_rights() const {
  return static_cast<std::size_t>(std::count_if(
      pages.begin(), pages.end(), [](const auto& page) { return page->rights != Page::Rights::kNothing; }));
}

/// Accepts the next connection. `poll` calls it, so an accept that fails, for example because the process has too many
/// open files, is repeated at most once in each poll.
void PageServer::Impl::accept() {
  if (accepts || exchanges >= kMaxConnections) return;
  accepts = true;
  acceptor.async_accept([this](beast::error_code error, tcp::socket socket) {
    accepts = false;
    if (!error) std::make_shared<Exchange>(*this, std::move(socket))->read();
  });
}

/// Runs the handlers that are ready.
void PageServer::Impl::run_handlers() {
  const auto end = std::chrono::steady_clock::now() + kMaxPoll;
  io.restart();
  while (io.poll_one() > 0 && std::chrono::steady_clock::now() < end) accept();
}

bool is_loopback(const std::string& address) {
  beast::error_code error;
  return asio::ip::make_address(address, error).is_loopback() && !error;
}

std::string host_name() {
  beast::error_code ignored;
  return asio::ip::host_name(ignored);
}

PageServer::PageServer(const ServerSettings& settings, const ViewerCore& core, const PlaybackStatus* playback)
    : impl_{std::make_unique<Impl>(*this, settings, core, playback)} {}

PageServer::~PageServer() {
  on_event = nullptr;
  on_request = nullptr;
  on_page_closed = nullptr;
  beast::error_code ignored;
  impl_->acceptor.close(ignored);
  for (const auto& page : impl_->pages) page->close();
}

void PageServer::poll(std::int64_t now_ns) {
  impl_->now_ns = now_ns;
  impl_->accept();
  impl_->run_handlers();
  for (const auto& page : impl_->pages) page->write();
  impl_->pages.remove_if([this](const auto& page) {
    if (page->is_closed && on_page_closed) on_page_closed(page->id);
    return page->is_closed;
  });
}

std::string PageServer::name_of(PageId page) const {
  for (const auto& each : impl_->pages)
    if (each->id == page) return each->name;
  return "unknown";
}

void PageServer::notify(PageId page, const std::string& text) {
  for (const auto& each : impl_->pages)
    if (each->id == page)
      each->notice = nlohmann::json{{"type", "notice"}, {"text", text}}.dump(-1, ' ', false,
                                                                             nlohmann::json::error_handler_t::replace);
}

std::uint16_t PageServer::port() const { return impl_->acceptor.local_endpoint().port(); }
std::size_t PageServer::pages() const {
  return static_cast<std::size_t>(
      std::count_if(impl_->pages.begin(), impl_->pages.end(), [](const auto& page) { return page->is_open; }));
}

bool PageServer::has_reader() const {
  return std::any_of(impl_->pages.begin(), impl_->pages.end(), [&](const auto& page) {
    return page->is_open && impl_->now_ns - page->could_receive_ns < kReaderNs;
  });
}

}  // namespace tactus::viewer
