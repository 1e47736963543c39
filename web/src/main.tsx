// The frame around every page: where one can go, whether the service is there, and in which light.

import { render } from 'preact';
import { useEffect, useRef } from 'preact/hooks';
import { Confirm } from './parts/confirm';
import { DropAnywhere } from './parts/drop';
import { Said } from './parts/say';
import { ComparePage } from './pages/compare';
import { JobPage } from './pages/job';
import { JobsPage } from './pages/jobs';
import { NewPage } from './pages/new';
import { SignInPage, SignOut } from './pages/signin';
import { SystemPage } from './pages/system';
import { unknown } from './api/client';
import { connect, connection, onReturn } from './state/live';
import { href, route, type PageName } from './state/route';
import { loadSession } from './state/session';
import { theme, type Theme } from './state/theme';

const PAGES: Record<PageName, () => preact.JSX.Element> = {
  jobs: JobsPage, job: JobPage, new: NewPage, compare: ComparePage, system: SystemPage, missing: Missing,
};

const NAVIGATION: { page: PageName; text: string }[] = [
  { page: 'jobs', text: 'Jobs' },
  { page: 'new', text: 'New' },
  { page: 'compare', text: 'Compare' },
  { page: 'system', text: 'System' },
];

const LIGHTS: Record<Theme, { next: Theme; mark: string; text: string }> = {
  auto: { next: 'light', mark: '◐', text: 'as the system' },
  light: { next: 'dark', mark: '☀', text: 'light' },
  dark: { next: 'auto', mark: '☾', text: 'dark' },
};

function Missing() {
  return <><h1 tabIndex={-1}>Nothing here</h1><p>There is no such page. <a href={href('jobs')}>To the jobs</a></p></>;
}

function Connection() {
  const state = connection.value;
  return (
    <span class={`connection ${state}`} role="status">
      <span aria-hidden="true" class="dot" /> {state === 'live' ? 'Live' : state === 'lost' ? 'Not connected' : 'Connecting'}
    </span>
  );
}

function Light() {
  const { next, mark, text } = LIGHTS[theme.value];
  return (
    <button type="button" class="plain" title={`Colours: ${text}`} onClick={() => { theme.value = next; }}>
      <span aria-hidden="true">{mark}</span><span class="unseen">Colours: {text}. Change</span>
    </button>
  );
}

function App() {
  const { page, id } = route.value;
  const Page = PAGES[page];
  const main = useRef<HTMLElement>(null);
  const first = useRef(true);
  // A new page is begun at its top, also for screen readers.
  useEffect(() => {
    const heading = main.current?.querySelector('h1');
    document.title = page === 'jobs' ? 'Meshway' : `${heading?.textContent ?? 'Meshway'} · Meshway`;
    if (!first.current) {
      scrollTo(0, 0);
      heading?.focus({ preventScroll: true });
    }
    first.current = false;
  }, [page, id]);
  return (
    <>
      <a class="skip" href="#main" onClick={(event) => {
        event.preventDefault();
        main.current?.focus();
      }}>To the content</a>
      <header class="top">
        <a class="brand" href={href('jobs')}>Meshway</a>
        <nav aria-label="Pages">
          {NAVIGATION.map(({ page: name, text }) => (
            <a href={href(name)} aria-current={page === name ? 'page' : undefined}>{text}</a>
          ))}
        </nav>
        <Connection />
        <SignOut />
        <Light />
      </header>
      {connection.value === 'lost' && !unknown.value && (
        <p class="banner" role="alert">The connection to the service is lost. It is tried again every two seconds; what you see may be old.</p>
      )}
      <main id="main" ref={main} tabIndex={-1}>{unknown.value ? <SignInPage /> : <Page key={`${page}/${id}`} />}</main>
      <Said />
      <Confirm />
      <DropAnywhere />
    </>
  );
}

const root = document.getElementById('app');
if (root) {
  root.replaceChildren();
  // Who is unknown gets the form to sign in; a service that is away is asked again when it is back.
  const look = () => void loadSession().catch(() => undefined);
  look();
  onReturn(look);
  render(<App />, root);
  connect();
}
