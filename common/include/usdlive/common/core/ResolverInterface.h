// The interface of the resolver plug-in for a client library in the same process.
#pragma once

namespace usdlive {

/// The functions that the plug-in exports for live projects. Both are built apart and linked to
/// nothing of one another, so these are C types. All functions may be called by any thread.
///
/// A live project has addresses of its own, `usdlive://HOST:PORT/@~TOKEN/PATH`: layers of the
/// project are the placeholder files in its folder, and all other files are read from the server.
struct ResolverInterface {
    /// Returns the token for a live project, which is the same for the same arguments and valid
    /// until the process ends. `server` is `HOST:PORT`, `prefix` the name of the project with a
    /// slash if addresses name it, `folder` has the placeholders.
    const char* (*live)(const char* server, const char* prefix, const char* folder);
    /// Says whether the server can be asked, and at which `HOST:PORT`. Files that are not in the
    /// cache are not found while it cannot.
    void (*connected)(const char* token, const char* server, int isConnected);
    /// Asks the server for its files. Calls `changed` for each file that was added, changed or
    /// removed since the last call, except for layers. Takes as long as a request, but ends soon
    /// after `isStopped` returns another number than 0. Returns 0 if the server did not answer.
    int (*refresh)(const char* token, void (*changed)(void* context, const char* path),
                   int (*isStopped)(void* context), void* context);
    /// Puts a file into the cache, and waits, unless `isStopped` returns another number than 0.
    void (*fetch)(const char* token, const char* path, int (*isStopped)(void* context),
                  void* context);
    /// Makes the stages of the project resolve their asset paths again. Call it on the thread that
    /// owns them.
    void (*notify)(const char* token);
};

/// The name of the function that returns them, a ResolverInterfaceFunction. A change of the
/// interface changes the number.
inline constexpr const char* kResolverInterface = "usdliveResolverInterface1";
using ResolverInterfaceFunction = const ResolverInterface* (*)();

}  // namespace usdlive
