// Arranges the panels: tree and layers on the left, the picture in the middle, properties, history and people on the right.
import { useSignal } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect } from "preact/hooks";
import { AdminPanel } from "./admin";
import { type Page, PageContext, type PhoneView, type Tab, usePage } from "./context";
import { HistoryPanel } from "./history";
import { Icon, type IconName } from "./icons";
import { Avatar, HealthPanel, LayersPanel, LineBanner, LineState, PeoplePanel } from "./overview";
import { PropertiesPanel } from "./properties";
import { SessionsPanel } from "./sessions";
import { TreePanel } from "./tree";
import { pressed, TimeBar, ViewportPanel } from "./viewport";

const PHONE = "(max-width: 760px)";

export function App({ page }: { page: Page }): JSX.Element {
  const isPhone = useSignal(matchMedia(PHONE).matches);
  useEffect(() => {
    const query = matchMedia(PHONE);
    const listener = () => {
      isPhone.value = query.matches;
    };
    query.addEventListener("change", listener);
    return () => query.removeEventListener("change", listener);
  }, []);
  useEffect(() => {
    const listener = (event: KeyboardEvent) => pressed(page, event);
    window.addEventListener("keydown", listener);
    return () => window.removeEventListener("keydown", listener);
  }, []);
  return (
    <PageContext.Provider value={page}>
      <div class={`app ${isPhone.value ? "phone" : "desk"}`} data-phone-view={page.phoneView.value}>
        <TopBar isPhone={isPhone.value} />
        <LineBanner />
        <SignIn />
        {!isPhone.value && (
          <aside class="left">
            <TreePanel />
            <LayersPanel />
          </aside>
        )}
        <main class="middle">
          <ViewportPanel />
          <TimeBar />
        </main>
        {isPhone.value ? (
          <div class="phone-panel">
            {page.phoneView.value === "overview" && (
              <>
                <HealthPanel />
                <PeoplePanel />
                <LayersPanel />
              </>
            )}
            {page.phoneView.value === "history" && <HistoryPanel />}
            {page.phoneView.value === "sessions" && <SessionsPanel />}
          </div>
        ) : (
          <RightSide />
        )}
        {isPhone.value && <PhoneBar />}
        <Notices />
      </div>
    </PageContext.Provider>
  );
}

function TopBar({ isPhone }: { isPhone: boolean }): JSX.Element {
  const page = usePage();
  const { session } = page;
  const welcome = session.welcome.value;
  const people = session.people.value;
  return (
    <header class="top-bar">
      <img class="logo" src="/icon.svg" alt="" width="22" height="22" />
      <h1 class="project">{welcome?.project || "usdlive"}</h1>
      {welcome?.session && (
        <span class="badge here" title={`This page shows the live session ${welcome.session}`}>
          {welcome.session}
        </span>
      )}
      {welcome && welcome.stages.length > 1 ? (
        <select
          aria-label="Stage"
          value={welcome.stage}
          onChange={(event) => void session.edit("stage", { layer: event.currentTarget.value }, "")}
        >
          {welcome.stages.map((stage) => (
            <option key={stage} value={stage}>
              {stage}
            </option>
          ))}
        </select>
      ) : (
        <span class="weak stage-name">{welcome?.stage}</span>
      )}
      <span class="space" />
      <LineState />
      {!isPhone && <span class="revision weak number">#{session.state.value?.revision ?? 0}</span>}
      <div class="avatars">
        {people.slice(0, isPhone ? 3 : 8).map((person) => (
          <button
            type="button"
            key={person.id}
            class={`avatar-button${page.followed.value === person.id ? " on" : ""}`}
            aria-label={`Follow ${person.user}`}
            title={`${person.user}: ${person.application}`}
            onClick={() => page.follow(page.followed.value === person.id || !person.camera ? undefined : person.id)}
          >
            <Avatar name={person.user} color={person.color} />
          </button>
        ))}
        {people.length > (isPhone ? 3 : 8) && <span class="weak">+{people.length - (isPhone ? 3 : 8)}</span>}
      </div>
      <button
        type="button"
        class="icon-button"
        aria-label={page.theme.value === "dark" ? "Light theme" : "Dark theme"}
        title={page.theme.value === "dark" ? "Light theme" : "Dark theme"}
        onClick={() => page.toggleTheme()}
      >
        <Icon name={page.theme.value === "dark" ? "sun" : "moon"} />
      </button>
    </header>
  );
}

function RightSide(): JSX.Element {
  const page = usePage();
  const tabs: [Tab, string][] = [
    ["properties", "Properties"],
    ["history", "History"],
    ["sessions", "Sessions"],
    ["people", "People"],
  ];
  if (page.session.welcome.value?.you.mayAdminister) tabs.push(["admin", "Admin"]);
  const shown = page.tab.value;
  return (
    <aside class="right">
      <div
        class="tabs"
        role="tablist"
        aria-label="Panels"
        onKeyDown={(event) => {
          const at = tabs.findIndex(([tab]) => tab === shown);
          const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
          const next = tabs[(at + step + tabs.length) % tabs.length];
          if (step === 0 || !next) return;
          page.tab.value = next[0];
          document.getElementById(`tab-${next[0]}`)?.focus();
        }}
      >
        {tabs.map(([tab, name]) => (
          <button
            type="button"
            key={tab}
            id={`tab-${tab}`}
            role="tab"
            aria-selected={shown === tab}
            aria-controls="panel"
            tabIndex={shown === tab ? 0 : -1}
            onClick={() => {
              page.tab.value = tab;
            }}
          >
            {name}
          </button>
        ))}
      </div>
      <div class="tab-content" id="panel" role="tabpanel" aria-labelledby={`tab-${shown}`}>
        {shown === "properties" && <PropertiesPanel />}
        {shown === "history" && <HistoryPanel />}
        {shown === "sessions" && <SessionsPanel />}
        {shown === "people" && (
          <>
            <PeoplePanel />
            <HealthPanel />
          </>
        )}
        {shown === "admin" && <AdminPanel />}
      </div>
    </aside>
  );
}

const PHONE_VIEWS: [PhoneView, IconName, string][] = [
  ["viewport", "mesh", "Stage"],
  ["overview", "people", "Overview"],
  ["history", "history", "History"],
  ["sessions", "live", "Sessions"],
];

function PhoneBar(): JSX.Element {
  const page = usePage();
  return (
    <nav class="phone-bar" aria-label="Views">
      {PHONE_VIEWS.map(([view, icon, name]) => (
        <button
          type="button"
          key={view}
          aria-pressed={page.phoneView.value === view}
          onClick={() => {
            page.phoneView.value = view;
          }}
        >
          <Icon name={icon} /> {name}
        </button>
      ))}
    </nav>
  );
}

/** Asks for a token where the server wants one. It is kept until the tab is closed. */
function SignIn(): JSX.Element | null {
  const page = usePage();
  const { session } = page;
  const line = session.line.value;
  const token = useSignal("");
  const wish = session.signIn.value;
  if (wish === undefined) {
    return line.state === "refused" ? (
      <div class="banner bad" role="alert">
        The gateway refused this page: {line.reason}
        <button type="button" class="link" onClick={() => session.reconnect()}>
          Try again
        </button>
      </div>
    ) : null;
  }
  return (
    <div class="dialog-back">
      <div class="dialog" role="dialog" aria-modal="true" aria-label="Sign in">
        <form
          onSubmit={(event) => {
            event.preventDefault();
            session.signInWith(token.value.trim());
            token.value = "";
          }}
        >
          <h2>Sign in</h2>
          <p>{wish}</p>
          <input
            type="password"
            class="field"
            autocomplete="off"
            placeholder="Token"
            aria-label="Token"
            value={token.value}
            onInput={(event) => {
              token.value = event.currentTarget.value;
            }}
          />
          <button type="submit" class="small primary" disabled={token.value.trim() === ""}>
            Sign in
          </button>
        </form>
      </div>
    </div>
  );
}

function Notices(): JSX.Element {
  const { session } = usePage();
  return (
    <div class="notices" role="status" aria-live="polite">
      {session.notices.value.map(({ number, text }) => (
        <div key={number} class="notice">
          <span>{text}</span>
          <button type="button" class="icon-button" aria-label="Dismiss" onClick={() => session.dismiss(number)}>
            <Icon name="close" />
          </button>
        </div>
      ))}
    </div>
  );
}
