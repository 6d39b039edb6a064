// SPDX-License-Identifier: Apache-2.0
//
// A TLS client's side of a handshake, as bytes: for clients that stop half way through one. It
// trusts whatever certificate it is shown, and offers HTTP/2.
//
// Thread safety: one thread.
//
//   TlsHandshake handshake;
//   connection.Send(handshake.Next(""));  // Its first words.
//   while (!handshake.done()) connection.Send(handshake.Next(connection.ReadSome()));
#ifndef SIGHTLINE_TESTS_INTEGRATION_TLS_HANDSHAKE_H_
#define SIGHTLINE_TESTS_INTEGRATION_TLS_HANDSHAKE_H_

#include <openssl/bio.h>
#include <openssl/ssl.h>

#include <memory>
#include <string>

namespace sightline {

class TlsHandshake {
 public:
  TlsHandshake() {
    constexpr unsigned char kHttp2[] = {2, 'h', '2'};
    SSL_set_alpn_protos(ssl_.get(), kHttp2, sizeof(kHttp2));
    SSL_set_connect_state(ssl_.get());
    SSL_set_bio(ssl_.get(), BIO_new(BIO_s_mem()), BIO_new(BIO_s_mem()));  // They are its own now.
  }

  bool done() const { return SSL_is_init_finished(ssl_.get()) != 0; }
  // What the client says once it has heard `from_server`.
  std::string Next(const std::string& from_server) {
    BIO_write(SSL_get_rbio(ssl_.get()), from_server.data(), static_cast<int>(from_server.size()));
    SSL_do_handshake(ssl_.get());
    std::string said(BIO_ctrl_pending(SSL_get_wbio(ssl_.get())), '\0');
    BIO_read(SSL_get_wbio(ssl_.get()), said.data(), static_cast<int>(said.size()));
    return said;
  }

 private:
  const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context_{SSL_CTX_new(TLS_client_method()),
                                                                   &SSL_CTX_free};
  const std::unique_ptr<SSL, decltype(&SSL_free)> ssl_{SSL_new(context_.get()), &SSL_free};
};

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_INTEGRATION_TLS_HANDSHAKE_H_
