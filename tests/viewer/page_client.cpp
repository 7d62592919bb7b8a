#include "tests/viewer/page_client.hpp"

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <stdexcept>

namespace tactus::test_support {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;

unsigned http_status(std::uint16_t port, const std::string& path, const std::map<std::string, std::string>& headers,
                     std::string* body) {
  asio::io_context io;
  beast::tcp_stream stream{io};
  stream.connect(tcp::endpoint{asio::ip::address_v4::loopback(), port});
  http::request<http::empty_body> request{http::verb::get, path, 11};
  request.set(http::field::host, "localhost:" + std::to_string(port));
  for (const auto& [name, value] : headers) request.set(name, value);
  http::write(stream, request);
  beast::flat_buffer buffer;
  http::response<http::string_body> response;
  beast::error_code error;
  http::read(stream, buffer, response, error);
  if (body != nullptr) *body = response.body();
  return error ? 0 : response.result_int();
}

struct PageClient::Impl {
  asio::io_context io;
  websocket::stream<beast::tcp_stream> socket{io};
  beast::flat_buffer buffer;
  int seen = 0;
};

PageClient::PageClient(std::uint16_t port, const std::string& origin) : impl_{std::make_unique<Impl>()} {
  beast::get_lowest_layer(impl_->socket).connect(tcp::endpoint{asio::ip::address_v4::loopback(), port});
  impl_->socket.set_option(websocket::stream_base::decorator([&](websocket::request_type& request) {
    if (!origin.empty()) request.set(http::field::origin, origin);
  }));
  impl_->socket.read_message_max(64u << 20);
  beast::error_code error;
  impl_->socket.handshake("localhost:" + std::to_string(port), "/session", error);
  if (error) throw std::runtime_error{"the server refuses the page: " + error.message()};
}

PageClient::~PageClient() = default;

void PageClient::send(const std::string& text) {
  impl_->socket.text(true);
  beast::error_code ignored;  // the server may close the connection at any time
  impl_->socket.write(asio::buffer(text), ignored);
}

std::optional<PageClient::Message> PageClient::receive(std::chrono::milliseconds patience) {
  std::optional<Message> message;
  impl_->buffer.clear();
  beast::get_lowest_layer(impl_->socket).expires_after(patience);
  impl_->socket.async_read(impl_->buffer, [&](beast::error_code error, std::size_t) {
    if (!error) message = {impl_->socket.got_text(), beast::buffers_to_string(impl_->buffer.data())};
  });
  impl_->io.restart();
  impl_->io.run();
  if (message && reports_seen) send(R"({"seen": )" + std::to_string(++impl_->seen) + "}");
  return message;
}

}  // namespace tactus::test_support
